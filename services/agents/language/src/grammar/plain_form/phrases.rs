//! Words of politeness, modal verbs, states, and words that sound alike.

/// Beginnings without a meaning of their own.
pub(super) const LEADS: [&str; 73] = [
    "but",
    "sorry to bother you but",
    "sorry to bother you",
    "excuse me but",
    "excuse me",
    "i was wondering whether",
    "i was wondering if",
    "i wonder whether",
    "i wonder if",
    "would it be possible to",
    "would it be possible that",
    "is it possible to",
    "is it possible that",
    "is there a way to",
    "would you be so kind as to",
    "would you be so kind to",
    "would you be so kind and",
    "would you mind if",
    "would you mind",
    "do you mind",
    "do you think you could",
    "do you think we could",
    "may i ask you to",
    "might i ask you to",
    "can i ask you to",
    "could i ask you to",
    "i would ask you to",
    "i'd appreciate it if you could",
    "i would appreciate it if you could",
    "it would be nice if you could",
    "it would be great if you could",
    "it would be nice if",
    "it would be great if",
    "it'd be great if",
    "if it is not too much trouble",
    "if it's not too much trouble",
    "if it 's not too much trouble",
    "if you don't mind",
    "if you do not mind",
    "if you could",
    "if you would",
    "if possible",
    "when you have a moment",
    "when you have time",
    "do me a favour and",
    "do me a favor and",
    "be so kind to",
    "be so kind and",
    "dear assistant",
    "hey assistant",
    "hello assistant",
    "hi assistant",
    "assistant",
    "computer",
    "dear computer",
    "hello there",
    "hi there",
    "good morning",
    "good afternoon",
    "please to",
    "please",
    "kindly",
    "we could",
    "you could",
    "can you",
    "could you",
    "would you",
    "can we",
    "could we",
    "and now",
    "now",
    "ok",
    "okay",
];

/// Ends without a meaning of their own.
pub(super) const TAILS: [&str; 26] = [
    "many thanks",
    "thanks a lot",
    "thanks so much",
    "thank you very much",
    "thank you so much",
    "thank you",
    "thanks",
    "cheers",
    "much appreciated",
    "please",
    "if you please",
    "if possible",
    "if you can",
    "if you don't mind",
    "if that is ok",
    "if that's ok",
    "when you can",
    "for a moment",
    "for a minute",
    "for a second",
    "for a while",
    "for now",
    "from now on",
    "for good",
    "instead",
    "nothing else",
];

/// Words of a wish: "I'd love a white background".
pub(super) const WISHES: [&str; 24] = [
    "i would love to have",
    "i'd love to have",
    "i would like to have",
    "i'd like to have",
    "i want to have",
    "i would love",
    "i'd love",
    "i would like",
    "i'd like",
    "i would prefer",
    "i'd prefer",
    "i want",
    "i need",
    "we need",
    "we want",
    "let 's try",
    "let's try",
    "let 's have",
    "let's have",
    "let me have",
    "to have",
    "have",
    "get",
    "try",
];

/// Verbs between a subject and what it becomes.
pub(super) const MODALS: [&str; 12] =
    ["should", "shall", "must", "could", "can", "may", "might", "would", "needs", "need", "has", "ought"];

/// Forms of "be" behind a modal.
pub(super) const BECOMES: [&str; 9] = ["be", "appear", "become", "look", "get", "turn", "go", "stay", "to"];

/// Softeners between them.
pub(super) const SOFTENERS: [&str; 10] =
    ["perhaps", "please", "maybe", "possibly", "also", "just", "really", "probably", "rather", "now"];

/// What a thing becomes, and the command for it.
pub(super) const STATES: [(&str, &str); 33] = [
    ("hidden", "hide X"),
    ("invisible", "hide X"),
    ("removed", "hide X"),
    ("removed from view", "hide X"),
    ("gone", "hide X"),
    ("away", "hide X"),
    ("off", "hide X"),
    ("switched off", "hide X"),
    ("turned off", "hide X"),
    ("out of the way", "hide X"),
    ("out of sight", "hide X"),
    ("shown", "show X"),
    ("visible", "show X"),
    ("visible again", "show X"),
    ("on", "show X"),
    ("on again", "show X"),
    ("back on", "show X"),
    ("back", "show X"),
    ("switched on", "show X"),
    ("turned on", "show X"),
    ("shown on its own", "show only X"),
    ("shown on their own", "show only X"),
    ("shown alone", "show only X"),
    ("on its own", "show only X"),
    ("on their own", "show only X"),
    ("alone", "show only X"),
    ("selected", "select X"),
    ("locked", "lock X"),
    ("protected", "lock X"),
    ("unlocked", "unlock X"),
    ("framed", "frame X"),
    ("centred", "frame X"),
    ("centered", "frame X"),
];

/// Verbs that set an amount: "drop the bone to 20 percent".
pub(super) const AMOUNTS: [&str; 20] = [
    "set", "drop", "take", "bring", "put", "lower", "raise", "turn", "dial", "reduce", "increase", "pull", "push",
    "move", "change", "adjust", "get", "make", "keep", "leave",
];

/// Words between its object and the amount.
pub(super) const AMOUNT_WORDS: [&str; 6] = ["down", "up", "back", "to", "at", "by"];

/// Degrees of transparency before a name.
pub(super) const TRANSPARENCIES: [&str; 7] = [
    "half transparent",
    "semi transparent",
    "fully transparent",
    "fully opaque",
    "transparent",
    "see through",
    "opaque",
];

/// What a clause says of a thing before the command about it: "the clip is in my way, hide it".
pub(super) const REMARKS: [&str; 9] = ["is", "are", "'s", "looks", "look", "seems", "gets", "blocks", "bothers"];

/// Openings of such a clause.
pub(super) const INTERESTS: [&str; 12] = [
    "i want to work on",
    "i want to look at",
    "i want to focus on",
    "i want to see",
    "i need to see",
    "i need to look at",
    "i'm interested in",
    "i am interested in",
    "i don't need",
    "i do not need",
    "see",
    "look at",
];

/// Words that recognizers and people write for others that sound alike, in commands.
pub(super) const HOMOPHONES: [(&str, &str); 17] = [
    ("high", "hide"),
    ("hyde", "hide"),
    ("shoe", "show"),
    ("inn", "in"),
    ("write", "right"),
    ("rite", "right"),
    ("wright", "right"),
    ("two", "to"),
    ("too", "to"),
    ("read", "red"),
    ("blew", "blue"),
    ("wight", "white"),
    ("sack", "sac"),
    ("lite", "light"),
    ("pail", "pale"),
    ("loch", "lock"),
    ("tern", "turn"),
];

/// Words that are written apart and mean one.
pub(super) const APART: [(&str, &str); 6] = [
    ("back ground", "background"),
    ("head light", "headlight"),
    ("over view", "overview"),
    ("book mark", "bookmark"),
    ("screen shot", "screenshot"),
    ("see through", "see-through"),
];
