//! The one table of what can be said: for each act the ways to begin, the form of what follows, and examples.
//!
//! The parser, the help text and the suggestions are all made from it, and a test says every example.

use sg_proto::language::Act;

use super::phrase::items;

/// How a clause goes on after its beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// A target and what becomes of it: a colour, an opacity, visibility, brightness ("the sac red").
    Becoming,
    /// A named property of a target and its new value ("the opacity of the sac to 0.3").
    Property,
    /// A property of a target that goes back to how it was ("the colour of the sac").
    Restoring,
    /// A target and how far it fades ("the rest to 20 percent").
    Fading,
    /// A target whose opacity grows, or its transparency shrinks ("the opacity of the sac by a third").
    Raising,
    /// A target whose opacity shrinks.
    Lowering,
    /// A target alone ("the sac").
    Target,
    /// A target and the word that completes the verb ("the sac off").
    Switching,
    /// A target followed by "only", "alone" or the like.
    TargetAlone,
    /// A change of the light said without a verb ("brighter", "less specular", "headlight").
    LightWords,
    /// A property of the light and its value, or a change of the light.
    LightProperty,
    /// Where the light comes from ("from the left").
    LightFrom,
    /// More light.
    LightUp,
    /// Less light.
    LightDown,
    /// A background and its colour, in either order.
    Background,
    /// A side to look from ("from the top", "top view").
    Side,
    /// A target to look at.
    LookAt,
    /// A turn: direction and angle in either order.
    Turn,
    /// A magnification.
    ZoomIn,
    /// A reduction.
    ZoomOut,
    /// A magnification by name ("to 200 percent").
    ZoomTo,
    /// A part of the shading ("the normals").
    Term,
    /// A target to select, then where to.
    Selecting,
    /// A target to take out of the selection.
    Unselecting,
    /// A target the selection is cut with.
    Intersecting,
    /// What is to be named, and its name.
    Naming,
    /// A name for what is shown ("the sac" after "this is").
    NameOnly,
    /// A unit and its new name.
    Renaming,
    /// A unit that is replaced with the selection.
    Updating,
    /// A unit to delete.
    Deleting,
    /// A subject of a question.
    Subject,
    /// A subject and a property asked for ("is the sac visible").
    Asking,
    /// How many steps.
    Steps,
    /// Nothing.
    Nothing,
}

/// Ways to begin, and how it goes on.
#[derive(Debug)]
pub(super) struct Construction {
    /// Phrases it begins with, set apart by `|`; `(none)` stands for no verb at all.
    pub(super) openings: &'static str,
    /// What follows.
    pub(super) form: Form,
}

impl Construction {
    /// The phrases one by one; no verb at all is the empty phrase.
    pub(super) fn phrases(&self) -> impl Iterator<Item = &'static str> {
        items(self.openings).map(|phrase| if phrase == "(none)" { "" } else { phrase })
    }
}

/// Everything about one kind of request.
#[derive(Debug)]
pub(super) struct Entry {
    /// What is asked for.
    pub(super) act: Act,
    /// What it is called in the help.
    pub(super) title: &'static str,
    /// How it may be said.
    pub(super) constructions: &'static [Construction],
    /// Examples; `{unit}` and `{other}` stand for names of units.
    pub(super) examples: &'static [&'static str],
}

const MAKE: &str = "make | turn | set | change | render | draw | show | show me | display | give | i want | i'd like | \
 i would like | keep | leave | put | switch | have | let | (none)";

const PAINT: &str = "colour | color | paint | recolour | recolor | repaint | tint | dye | stain | highlight | fill | \
 shade";

const SET: &str = "set | change | make | put | bring | turn | switch | adjust | use | give | (none)";

const SHOW: &str = "show | show me | display | reveal | unhide | bring back | bring up | turn on | switch on | \
 turn back on | let me see | can i see | could i see | may i see | i want to see | i'd like to see | \
 i would like to see | see | uncover | draw";

/// The table, in the order of the help. Where two readings fit equally well the earlier one is taken.
pub(super) const TABLE: &[Entry] = &[
    Entry {
        act: Act::SetColor,
        title: "colour",
        constructions: &[
            Construction { openings: PAINT, form: Form::Becoming },
            Construction { openings: MAKE, form: Form::Becoming },
            Construction { openings: SET, form: Form::Property },
            Construction {
                openings: "reset | restore | give back | bring back | revert | clear | remove | undo | give | \
                 make",
                form: Form::Restoring,
            },
        ],
        examples: &[
            "make the {unit} red",
            "colour the {unit} forest green",
            "make the {unit} green and the {other} brown",
            "paint it #ff8800",
            "turn the {unit} blue",
            "set the colour of the {unit} to light blue",
            "give the {unit} a dark red colour",
            "restore the colour of the {unit}",
        ],
    },
    Entry {
        act: Act::SetOpacity,
        title: "opacity",
        constructions: &[
            Construction { openings: MAKE, form: Form::Becoming },
            Construction { openings: SET, form: Form::Property },
            Construction {
                openings: "fade | fade out | fade down | dim | ghost | tone down | thin | thin out",
                form: Form::Fading,
            },
            Construction {
                openings: "increase | raise | boost | double | triple | turn up | strengthen",
                form: Form::Raising,
            },
            Construction {
                openings: "decrease | reduce | lower | halve | drop | cut | turn down | weaken",
                form: Form::Lowering,
            },
            Construction { openings: "reset | restore | bring back", form: Form::Restoring },
        ],
        examples: &[
            "fade everything else to 20 percent",
            "set the opacity of the {unit} to 0.3",
            "make the {unit} half transparent",
            "make it more transparent",
            "dim the {unit} by 50 %",
            "make the {unit} opaque",
            "set the transparency of the {unit} to 80 %",
            "reduce the opacity of the {unit} by a third",
        ],
    },
    Entry {
        act: Act::ShowOnly,
        title: "show one thing alone",
        constructions: &[
            Construction {
                openings: "show only | show just | see only | see just | show me only | show me just | only show | just show | \
                 only show me | just show me | show nothing but | show me nothing but | \
                 display only | only display | display just | isolate | solo | single out | \
                 let me see only | let me see just | keep only | only keep | leave only | only",
                form: Form::Target,
            },
            Construction { openings: SHOW, form: Form::TargetAlone },
        ],
        examples: &["show only the {unit}", "isolate the {unit}", "show the {unit} alone"],
    },
    Entry {
        act: Act::Show,
        title: "show",
        constructions: &[
            Construction { openings: SHOW, form: Form::Target },
            Construction { openings: "turn | switch | bring", form: Form::Switching },
            Construction { openings: MAKE, form: Form::Becoming },
        ],
        examples: &["show the {unit}", "show everything", "bring back the {unit}", "make the {unit} visible"],
    },
    Entry {
        act: Act::Hide,
        title: "hide",
        constructions: &[
            Construction {
                openings: "hide | conceal | turn off | switch off | remove | take away | take out | take off | \
                 get rid of | don't show | do not show | suppress",
                form: Form::Target,
            },
            Construction { openings: "turn | switch | take | remove", form: Form::Switching },
            Construction { openings: MAKE, form: Form::Becoming },
        ],
        examples: &[
            "hide the {unit}",
            "hide the {unit} and the {other}",
            "switch off the {unit}",
            "hide everything else",
        ],
    },
    Entry {
        act: Act::SetLight,
        title: "light",
        constructions: &[
            Construction { openings: "(none) | make | with | use | i want | give me | add", form: Form::LightWords },
            Construction { openings: "set | change | make | put | turn | adjust | (none)", form: Form::LightProperty },
            Construction { openings: MAKE, form: Form::Becoming },
            Construction {
                openings: "light | illuminate | put the light | move the light | place the light | \
                 set the light | shine the light | shine light | shine | turn the light | \
                 point the light | the light comes | bring the light",
                form: Form::LightFrom,
            },
            Construction {
                openings: "turn up | increase | raise | boost | brighten | brighten up | double | triple | \
                 strengthen",
                form: Form::LightUp,
            },
            Construction {
                openings: "turn down | decrease | reduce | lower | dim | darken | halve | weaken | turn off | \
                 switch off | remove",
                form: Form::LightDown,
            },
            Construction {
                openings: "turn on | switch on | switch to | turn to | go to | go back to",
                form: Form::LightWords,
            },
        ],
        examples: &[
            "brighter",
            "use a headlight",
            "light from the left",
            "light it from above",
            "more specular",
            "less ambient",
            "make it shinier",
            "turn down the light",
            "set the ambient light to 50 %",
        ],
    },
    Entry {
        act: Act::SetBackground,
        title: "background",
        constructions: &[Construction {
            openings: "(none) | set | change | make | turn | paint | colour | color | use | switch | switch to | \
             put | give me | i want | on | against | with | fill | put it on | show it on | \
             put it against | have",
            form: Form::Background,
        }],
        examples: &["white background", "set the background to dark grey", "make the background black"],
    },
    Entry {
        act: Act::SetView,
        title: "view and zoom",
        constructions: &[
            Construction {
                openings: "(none) | view | look | see | show | show me | display | go | go to | go back to | \
                 switch to | change to | move to | set | change | let me see | i want to see | \
                 can i see | give me | use | look at | turn to | reset | restore | move | back to | \
                 return to | recentre | recenter | put | bring",
                form: Form::Side,
            },
            Construction {
                openings: "look at | look closer at | zoom in closer on | zoom closer to | bring | take a look at | focus on | focus | centre on | \
                 center on | centre | center | frame | go to | fly to | move to | zoom to | \
                 zoom on | zoom onto | zoom in on | zoom in to | zoom into | fit | take me to | \
                 point the camera at | aim at | bring into view | show me where | home in on | \
                 get closer to | closer to",
                form: Form::LookAt,
            },
            Construction {
                openings: "rotate | turn | spin | orbit | tilt | swing | move | go | revolve",
                form: Form::Turn,
            },
            Construction {
                openings: "zoom in | zoom closer | closer | get closer | go closer | come closer | \
                 move closer | move in | magnify | enlarge | bigger | larger | make it bigger | \
                 make it larger | nearer | zoom it in | zoom the view in | a bit closer | \
                 a little closer | much closer",
                form: Form::ZoomIn,
            },
            Construction {
                openings: "zoom out | zoom back | zoom back out | zoom away | further away | farther away | \
                 move back | move out | move away | go further away | step back | smaller | \
                 make it smaller | shrink | further out | pull back",
                form: Form::ZoomOut,
            },
            Construction { openings: "zoom | magnify | set the zoom | zoom the view", form: Form::ZoomTo },
            Construction { openings: MAKE, form: Form::Becoming },
        ],
        examples: &[
            "view from the top",
            "look at the {unit}",
            "rotate left 30 degrees",
            "turn it up",
            "reset the view",
            "zoom in",
            "zoom out twice",
            "zoom to 200 %",
        ],
    },
    Entry {
        act: Act::SetTerm,
        title: "parts of the shading",
        constructions: &[Construction {
            openings: "(none) | show | show me | show only | show just | show me only | only show | just show | \
             display | display only | view | render | draw | switch to | switch back to | \
             go back to | back to | use | set | let me see | only | just | restore | return to | \
             turn on",
            form: Form::Term,
        }],
        examples: &["show the normals", "show only the diffuse term", "full shading"],
    },
    Entry {
        act: Act::Select,
        title: "select",
        constructions: &[
            Construction { openings: "add | also select | also pick | include", form: Form::Selecting },
            Construction {
                openings: "select | pick | choose | highlight | mark | grab | pick out | select only | \
                 select just",
                form: Form::Selecting,
            },
            Construction {
                openings: "deselect | unselect | remove | take | subtract | exclude | drop | leave",
                form: Form::Unselecting,
            },
            Construction { openings: "intersect | restrict | limit", form: Form::Intersecting },
            Construction {
                openings: "invert the selection | invert selection | flip the selection | \
                 reverse the selection | invert it",
                form: Form::Nothing,
            },
        ],
        examples: &[
            "select the {unit}",
            "add the {other} to the selection",
            "remove the {other} from the selection",
            "invert the selection",
        ],
    },
    Entry {
        act: Act::ClearSelection,
        title: "select nothing",
        constructions: &[Construction {
            openings: "clear the selection | clear selection | clear my selection | deselect | deselect all | \
             deselect everything | deselect it all | unselect | unselect all | unselect everything | \
             select nothing | select none | drop the selection | cancel the selection | \
             empty the selection | remove the selection | discard the selection | \
             forget the selection | reset the selection | delete the selection | \
             erase the selection | deselect the selection",
            form: Form::Nothing,
        }],
        examples: &["clear the selection", "deselect"],
    },
    Entry {
        act: Act::Label,
        title: "name the selection",
        constructions: &[
            Construction {
                openings: "call | name | label | save | store | tag | keep | remember | make | create | add",
                form: Form::Naming,
            },
            Construction { openings: "this is | that is | these are | those are | that's", form: Form::NameOnly },
            Construction { openings: "update | overwrite | replace | redefine", form: Form::Updating },
        ],
        examples: &[
            "call this the {unit}",
            "save the selection as {unit}",
            "label it 'left root'",
            "update the {unit}",
        ],
    },
    Entry {
        act: Act::Rename,
        title: "rename",
        constructions: &[Construction {
            openings: "rename | relabel | call | name | change the name of",
            form: Form::Renaming,
        }],
        examples: &["rename the {unit} to dome", "call the {unit} aneurysm"],
    },
    Entry {
        act: Act::Delete,
        title: "delete",
        constructions: &[Construction {
            openings: "delete | erase | discard | forget | remove | drop | throw away | get rid of",
            form: Form::Deleting,
        }],
        examples: &["delete the {unit}", "delete the unit {unit}"],
    },
    Entry {
        act: Act::List,
        title: "list",
        constructions: &[Construction {
            openings: "list | list them | list all | list everything | list the units | list all units | \
             list units | list all the units | list the structures | list all structures | \
             list the labels | list the parts | list the objects | give me a list | \
             give me a list of the units | give me a list of units | give me a list of all units | \
             show me a list | show a list | show me a list of the units | show the list of units | \
             show me the list of units | guided list of units | list of units | what is there | \
             what's there | what is in there | what is here | what is in the scene | \
             what's in the scene | what is in this scene | what's in this scene | \
             what is in the picture | what can i see | what is visible | what's visible | \
             what is shown | what is hidden | what's hidden | what units are there | \
             what units exist | what units do you know | which units are there | which units exist | \
             what structures are there | which structures are there | what structures can i see | \
             which structures can i see | which structures do you know | \
             what structures do you know | what labels are there | which labels are there | \
             what parts are there | which parts are there | what objects are there | \
             which objects are there | what are the units | what are the structures | \
             what are the units called | name the units | name all units | \
             how many units are there | how many structures are there | which units are visible | \
             which units are hidden | what units are visible | what units are hidden | \
             what do we have | what have we got | what can i select | what can i colour | \
             what can i color",
            form: Form::Nothing,
        }],
        examples: &["list the units", "what is there?", "which structures can I see?"],
    },
    Entry {
        act: Act::QuerySelection,
        title: "ask about the selection",
        constructions: &[Construction {
            openings: "what is selected | what's selected | what is currently selected | \
             what is selected now | what is the selection | what's the selection | \
             what is the current selection | what is in the selection | what's in the selection | \
             what have i selected | what did i select | what do i have selected | \
             what i have selected | what am i selecting | is anything selected | \
             is something selected | is there a selection | how many are selected | \
             how much is selected | how many gaussians are selected | how many points are selected | \
             how big is the selection | how large is the selection | describe the selection | \
             tell me about the selection | which part is selected | which unit is selected | \
             which structure is selected | which units are selected | show me what is selected | \
             what's currently selected",
            form: Form::Nothing,
        }],
        examples: &["what is selected?", "how big is the selection?"],
    },
    Entry {
        act: Act::Describe,
        title: "describe",
        constructions: &[
            Construction {
                openings: "describe | what is | what's | what are | tell me about | tell me more about | \
                 tell me something about | explain | how big is | how big are | how large is | \
                 how large are | how small is | how many gaussians has | how many gaussians are in | \
                 how many gaussians does | how many points does | how transparent is | \
                 how transparent are | how opaque is | how opaque are | what colour is | \
                 what colour are | what color is | what color are | what colour has | \
                 which colour is | which color is | which colour has | what is the colour of | \
                 what is the color of | what's the colour of | what's the color of | \
                 what is the opacity of | what's the opacity of | what is the size of | \
                 what's the size of | what are the properties of | how visible is | \
                 how much of the picture is | how much of the scene is | what about | info on | \
                 information about | details of | details about",
                form: Form::Subject,
            },
            Construction { openings: "is | are", form: Form::Asking },
            Construction {
                openings: "describe | describe it all | describe what you see | describe the view | \
                 what do you see | what can you see | tell me what you see | what am i looking at | \
                 what are we looking at | what is this scene | what does the scene look like | \
                 how many gaussians are there | how many gaussians",
                form: Form::Nothing,
            },
        ],
        examples: &["describe the scene", "what is the {unit}?", "how big is the {unit}?", "is the {unit} visible?"],
    },
    Entry {
        act: Act::Undo,
        title: "undo",
        constructions: &[Construction {
            openings: "undo | take back | take that back | take it back | go back | revert | roll back | \
             rollback",
            form: Form::Steps,
        }],
        examples: &["undo", "undo twice", "take back the last 3 changes"],
    },
    Entry {
        act: Act::Redo,
        title: "redo",
        constructions: &[Construction { openings: "redo | do again | bring back | reapply", form: Form::Steps }],
        examples: &["redo", "redo twice"],
    },
    Entry {
        act: Act::Reset,
        title: "start over",
        constructions: &[Construction {
            openings: "reset | reset everything | reset all | reset it all | reset the scene | \
             reset the look | reset the appearance | reset the looks | reset all changes | \
             start over | start again | start from scratch | back to the start | \
             back to the beginning | go back to the start | go back to the beginning | \
             back to square one | restore everything | restore the original look | \
             restore the scene | restore the original | original look | back to the original | \
             back to the original look | go back to the original look | make everything as it was",
            form: Form::Nothing,
        }],
        examples: &["reset", "start over"],
    },
    Entry {
        act: Act::Help,
        title: "help",
        constructions: &[Construction {
            openings: "help | help me | show help | show me help | show me the help | i need help | \
             what can i say | what can i do | what can i ask | what can i ask you | \
             what can i tell you | what can you do | what can you do for me | \
             what do you understand | what can you understand | what commands are there | \
             which commands are there | what commands do you know | what are the commands | \
             list the commands | list commands | show me the commands | commands | \
             how does this work | how do i use this | what are my options | what should i say",
            form: Form::Nothing,
        }],
        examples: &["help", "what can I say?"],
    },
];

/// Names that stand in examples where the scene has none of its own.
const SAMPLE_NAMES: [&str; 2] = ["sac", "vessel"];

/// An example with names of units in it.
pub(super) fn spoken(example: &str, names: &[&str]) -> String {
    let unit = names.first().copied().unwrap_or(SAMPLE_NAMES[0]);
    let other = names.get(1).copied().unwrap_or(SAMPLE_NAMES[1]);
    example.replace("{unit}", unit).replace("{other}", other)
}

/// Every example of the table with names of the scene's units in it.
#[must_use]
pub fn examples(names: &[&str]) -> Vec<String> {
    TABLE.iter().flat_map(|entry| entry.examples).map(|example| spoken(example, names)).collect()
}

/// What can be said, one line for each kind of request, with names of the scene's units in the examples.
#[must_use]
pub fn help(names: &[&str]) -> String {
    let mut text = String::from("You can say, for example:");
    for entry in TABLE {
        let examples: Vec<String> =
            entry.examples.iter().take(3).map(|example| format!("“{}”", spoken(example, names))).collect();
        text.push_str(&format!("\n  {}: {}", entry.title, examples.join(", ")));
    }
    text.push_str("\nSeveral at once work too: “");
    text.push_str(&spoken("make the {unit} red and fade everything else to 20 percent, then zoom in", names));
    text.push_str("”.");
    text
}
