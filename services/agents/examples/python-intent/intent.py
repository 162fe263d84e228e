"""The intent agent in Python: understands colour, opacity, hiding, showing and undoing by rules of keywords.

It fills the role `agent-intent`: it answers `cmd/parse`, publishes `event/intent` and owns `state`. What its rules do not
cover it says it has not understood; it never guesses.
"""

import re
import sys

import sg_service as sg
from supergaussian.language.v1 import language_pb2 as language
from supergaussian.scene.v1 import scene_pb2 as scene

ROLE = "agent-intent"
VERSION = "0.1.0"
BACKEND = "python-keywords"
MAX_UTTERANCE_BYTES = 4096
# Largest number of clauses in an utterance.
MAX_CLAUSES = 64

COLORS = {
    "black": (0.0, 0.0, 0.0),
    "white": (1.0, 1.0, 1.0),
    "grey": (0.5, 0.5, 0.5),
    "gray": (0.5, 0.5, 0.5),
    "red": (1.0, 0.0, 0.0),
    "green": (0.0, 0.502, 0.0),
    "blue": (0.0, 0.0, 1.0),
    "yellow": (1.0, 1.0, 0.0),
    "orange": (1.0, 0.647, 0.0),
    "purple": (0.502, 0.0, 0.502),
    "pink": (1.0, 0.753, 0.796),
    "brown": (0.647, 0.165, 0.165),
    "cyan": (0.0, 1.0, 1.0),
    "magenta": (1.0, 0.0, 1.0),
}
OPACITIES = {"transparent": 0.3, "translucent": 0.3, "see-through": 0.3, "half-transparent": 0.5, "opaque": 1.0}

COLOR = "|".join(COLORS)
OPACITY = "|".join(OPACITIES)
NUMBER = r"(?P<number>\d+(?:\.\d+)?)\s*(?P<percent>%|percent)?"
# Words that begin a clause. A part without one continues the list of names before it.
VERBS = r"make|turn|colou?r|paint|hide|show|display|reveal|fade|set|undo|redo|take back|bring back"

# (pattern, act): the first pattern that matches the whole clause wins.
RULES = [
    (rf"(?:make|turn|colou?r|paint)\s+(?P<target>.+?)\s+(?P<color>{COLOR})", language.ACT_SET_COLOR),
    (rf"set\s+(?:the\s+)?colou?r\s+of\s+(?P<target>.+?)\s+to\s+(?P<color>{COLOR})", language.ACT_SET_COLOR),
    (rf"make\s+(?P<target>.+?)\s+(?P<opacity>{OPACITY})", language.ACT_SET_OPACITY),
    (rf"fade\s+(?P<target>.+?)\s+to\s+{NUMBER}", language.ACT_SET_OPACITY),
    (rf"set\s+(?:the\s+)?opacity\s+of\s+(?P<target>.+?)\s+to\s+{NUMBER}", language.ACT_SET_OPACITY),
    (r"(?:show|display)\s+only\s+(?P<target>.+)", language.ACT_SHOW_ONLY),
    (r"hide\s+(?P<target>.+)", language.ACT_HIDE),
    (r"(?:show|display|reveal)\s+(?P<target>.+)", language.ACT_SHOW),
    (r"undo(?:\s+(?:that|it|the last (?:change|step)))?|take back(?:\s+(?:that|it))?", language.ACT_UNDO),
    (r"redo(?:\s+(?:that|it))?|bring back(?:\s+(?:that|it))?", language.ACT_REDO),
]
RULES = [(re.compile(pattern, re.IGNORECASE), act) for pattern, act in RULES]
SUGGESTIONS = ["make {} red", "fade everything else to 20 percent", "hide {}", "undo"]

# Placeholder of a known name during parsing.
MARK = re.compile(r"<(\d+)>")

EVERYTHING = {"everything", "all", "the scene", "the whole scene", "the whole volume"}
REST = {"everything else", "the rest", "all else", "the others"}
FOCUS = {"it", "them"}
SELECTION = {"the selection", "selection", "what is selected", "the selected part", "this", "that"}


def known_names(request: language.IntentRequest) -> list[str]:
    """Names of the scene's units, longest first."""
    state = request.observation.scene
    names = [unit.name for unit in state.base_units] + [unit.name for unit in state.units]
    return sorted(filter(None, names), key=len, reverse=True)


def parts_of(text: str, names: list[str]) -> list[str]:
    """The clauses of an utterance with placeholders for known names: a name may be "salt and pepper"."""
    for number, name in enumerate(names):
        text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", f"<{number}>", text, flags=re.IGNORECASE)
    clauses: list[str] = []
    # A full stop or "then" ends a clause; a comma or "and" may continue its list of names.
    for sentence in re.split(r"[;!?]|\.(?!\d)|\bthen\b", text, flags=re.IGNORECASE):
        begun = False
        for piece in re.split(r",|\band\b", sentence, flags=re.IGNORECASE):
            piece = re.sub(r"^please\s+|\s+please$", "", piece.strip(), flags=re.IGNORECASE)
            if not piece:
                continue
            if begun and not re.match(rf"(?:{VERBS})\b", piece, re.IGNORECASE) and takes_more(clauses[-1]):
                clauses[-1] += f" and {piece}"
            else:
                clauses.append(piece)
            begun = True
    return clauses


def spoken(words: str, names: list[str]) -> str:
    """The words with the names in place of their placeholders."""
    return MARK.sub(lambda mark: names[int(mark[1])], words)


def takes_more(clause: str) -> bool:
    """Whether names may follow: "hide the soil" may continue, "make the soil red" is complete."""
    return re.match(r"(?:hide|show|display|reveal)\b", clause, re.IGNORECASE) is not None or not any(
        pattern.fullmatch(clause) for pattern, _ in RULES
    )


def reference(words: str, names: list[str]) -> language.Reference | None:
    """The target of a clause. Unknown names stay as they were spoken; the function agent refuses them."""
    target = language.Reference()
    for item in re.split(r"\s*(?:,|\band\b)\s*", words):
        plain = item.strip().lower()
        bare = re.sub(r"^(?:the|a|an|my)\s+", "", plain)
        if MARK.fullmatch(bare):
            target.names.append(spoken(bare, names))
        elif plain in EVERYTHING:
            target.everything = True
        elif plain in REST:
            target.complement = True
        elif plain in FOCUS:
            target.focus = True
        elif plain in SELECTION:
            target.selection = True
        elif bare and len(bare.split()) <= 4 and not MARK.search(bare):
            target.names.append(bare)
        else:
            return None
    return target


def clause_of(words: str, names: list[str]) -> language.Clause | None:
    """One clause, or None without a matching rule."""
    for pattern, act in RULES:
        match = pattern.fullmatch(words)
        if not match:
            continue
        found = match.groupdict()
        clause = language.Clause(act=act, words=spoken(words, names))
        if found.get("target"):
            target = reference(found["target"], names)
            if target is None:
                return None
            clause.target.CopyFrom(target)
        if found.get("color"):
            clause.color_name = found["color"].lower()
            red, green, blue = COLORS[clause.color_name]
            clause.color.CopyFrom(scene.Color(red=red, green=green, blue=blue))
        if found.get("opacity"):
            clause.amount = OPACITIES[found["opacity"].lower()]
        if found.get("number"):
            number = float(found["number"])
            # "fade it to 20" means percent.
            clause.amount = number / 100 if found["percent"] or number > 1 else number
        return clause
    return None


def understand(request: language.IntentRequest) -> language.Intent:
    """The intent of an utterance. The result is deterministic."""
    if len(request.text.encode()) > MAX_UTTERANCE_BYTES:
        size = len(request.text.encode())
        raise sg.invalid(f"the utterance has {size} bytes; say it in at most {MAX_UTTERANCE_BYTES}")
    if not request.text.strip():
        raise sg.invalid("nothing was said; try “undo”")
    names = known_names(request)
    # The utterance must not hold placeholders.
    text = re.sub(r"[<>]", " ", request.text)
    intent = language.Intent(backend=BACKEND)
    for words in parts_of(text, names):
        clause = clause_of(words, names) if len(intent.clauses) < MAX_CLAUSES else None
        if clause is None:
            intent.not_understood.append(spoken(words, names))
        else:
            intent.clauses.append(clause)
    if intent.not_understood or not intent.clauses:
        if not intent.clauses and not intent.not_understood:
            intent.not_understood.append(request.text)
        name = f"the {names[-1]}" if names else "everything"
        intent.suggestions.extend(text.format(name) for text in SUGGESTIONS[:3])
    return intent


def main() -> int:
    args = sg.arguments()
    try:
        service = sg.Service(args, VERSION)
        if args.role != ROLE:
            raise sg.InputError(f"role `{args.role}`: this executable serves `{ROLE}`")
        if service.params:
            raise sg.InputError(f"parameters of `{ROLE}`: unknown `{next(iter(service.params))}`; it takes none")
    except sg.InputError as error:
        sg.log("ERROR", str(error))
        return sg.EXIT_INPUT
    told = language.AgentState(backend=BACKEND)
    state = service.own("state", told)

    def parse(request: language.IntentRequest, context: sg.Context) -> language.Intent:
        told.answered += 1
        try:
            intent = understand(request)
        except sg.Refusal:
            told.refused += 1
            raise
        finally:
            state.set(told, context)
        told.refused += bool(intent.not_understood)
        service.publish("event/intent", intent, context)
        return intent

    service.answer("cmd/parse", language.IntentRequest, ("agent-core", "supervisor", "cli"), parse)
    return service.run()


if __name__ == "__main__":
    sys.exit(main())
