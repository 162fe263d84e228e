//! Words that tell what a command is about, wherever they stand in it.

/// What a word or a phrase tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cue {
    /// Nothing of its own.
    Filler,
    /// Joins things.
    And,
    /// No command is read from such an utterance: a negation, a question, a condition, or an act that a look does not undo.
    Block,
    /// A verb that sets anything.
    Set,
    /// A verb of colours.
    Paint,
    /// "Colour", "shade".
    ColorNoun,
    /// One colour in place of another.
    Swap,
    /// "Opacity", "alpha".
    Opacity,
    /// "Transparency".
    Transparency,
    /// "Solid", "dense".
    Opaque,
    /// "See-through".
    Transparent,
    /// "Like a ghost", "barely visible".
    Faint,
    /// "Fade".
    Fade,
    More,
    Less,
    Up,
    Down,
    Slightly,
    Much,
    Half,
    Double,
    /// Before the amount of a change.
    By,
    Hide,
    Show,
    Only,
    /// "Nothing" but an exception.
    Nothing,
    Except,
    Light,
    Headlight,
    Ambient,
    Diffuse,
    Specular,
    Shiny,
    Bright,
    Dark,
    Vivid,
    Dull,
    Warm,
    Cool,
    Background,
    Left,
    Right,
    Above,
    Below,
    Behind,
    Front,
    /// "Back": the rear side, or a return.
    Back,
    /// The camera, the view.
    View,
    Rotate,
    Degrees,
    Nearer,
    Farther,
    Frame,
    /// A view without anything in the way.
    Best,
    /// As it was at the start.
    Initial,
    Reset,
    Select,
    Add,
    /// What is not selected.
    Inverse,
    Selection,
    Deselect,
    Lock,
    Unlock,
    Normals,
    /// "Term", "shading".
    Shading,
}

use Cue::{
    Above, Add, Ambient, And, Back, Background, Behind, Below, Best, Block, Bright, By, ColorNoun, Cool, Dark, Degrees,
    Deselect, Diffuse, Double, Down, Dull, Except, Fade, Faint, Farther, Filler, Frame, Front, Half, Headlight, Hide,
    Initial, Inverse, Left, Less, Light, Lock, More, Much, Nearer, Normals, Nothing, Only, Opacity, Opaque, Paint,
    Reset, Right, Rotate, Select, Selection, Set, Shading, Shiny, Show, Slightly, Specular, Swap, Transparency,
    Transparent, Unlock, Up, View, Vivid, Warm,
};

/// The phrases of each cue. A word counts in any inflection.
pub(super) const CUES: &[(Cue, &str)] = &[
    (
        Filler,
        "a | an | the | some | both | see | seen | remain | remains | fall | falls | falling | straight | straight down | blinds me | dazzles me | \
         could do with | would look better | find | an angle where | a view where | of all | every part of it | you're at it |  of | to | in | into | on | onto | at | for | as | than | then | now | please | pls | plz | \
         just | also | so | that | which | is | are | be | am | was | were | been | it | its | 's | them | their | they | \
         this | these | those | there | here | i | i'm | me | my | mine | we | us | our | you | your | would | could | \
         can | should | shall | may | might | must | will | i'd | i'll | we'd | you'd | let | lets | let's | like to | \
         love to | like | love | prefer | rather | want | wish | need | needs | has to | have to | ought to | bit of | \
         kind of | sort of | really | actually | perhaps | maybe | possibly | somehow | quite | very | too | \
         for me | for us | in here | in there | right now | at the moment | again | instead | thanks | thank you | hey | \
         hi | hello | ok | okay | um | uh | er | erm | hmm | well | oh | yes | yeah | alright | sorry | go ahead and | \
         be so kind and | would you mind | if possible | if you can | if you could | able to | possible | i think | \
         i guess | you know | nice | nicer | good | pretty | simply | completely | totally | entirely | fully | \
         a little of | with | and then | when you can | whole | entire | shown | displayed | rendered | drawn | \
         i can't really see | i can barely see | i can hardly see | i can barely make out | i can't see | \
         can't really see | can barely see | going to | gonna | wanna | i wanna | time to | by the way | try to | try | \
         together | from now on | for a moment | for now | surface | surfaces | side | sides | direction | place | \
         as possible | out of it | overall",
    ),
    (And, "and | plus | as well as | together with | along with"),
    (
        Block,
        "getting | not | no | never | don't | dont | doesn't | isn't | won't | wouldn't | shouldn't | mustn't | neither | nor | if | \
         unless | until | while | before | after | because | when | why | who | whom | how | what | where | whether | \
         delete | erase | wipe | purge | destroy | crop | cut | export | download | upload | send | mail | save | \
         store | keep | remember | open | load | import | rename | name | call | label | merge | combine | join | \
         duplicate | copy | clone | undo | redo | segment | print | book | play | buy | order | google | search | \
         translate | write | tell | say | explain | compare | measure | record | tour | bookmark | picture | screenshot | \
         ignore | pretend | imagine | suppose | system | file | folder | password | instructions | rules | move | \
         forget | throw | leave",
    ),
    (
        Set,
        "make | makes | made | set | turn | put | give | get | have | has | use | render | draw | display | change | \
         adjust | take | bring | go | come | comes | look | looks | appear | become | do | apply | switch | drop | \
         dial | crank | push | pull | tone | stay | appearing | it to be | try out | i'd like to see | i would like to see | \
         i want to see | i'd love to see | let me see | let us see | i need to see | we need to see | want to see",
    ),
    (
        Paint,
        "paint | colour | color | recolour | recolor | dye | tint | stain | tinge | highlight in | coloured | colored",
    ),
    (
        ColorNoun,
        "the colour | the color | shade | hue | shades | colour of | color of | in colour | in color | paint job",
    ),
    (Swap, "swap | exchange | replace"),
    (Opacity, "opacity | alpha | opacity of | density | opaqueness | solidity"),
    (Transparency, "transparency | translucency"),
    (Opaque, "opaque | solid | dense | denser | thick | thicker | strong | stronger | solider | substantial"),
    (
        Transparent,
        "transparent | translucent | clear as glass | as clear as glass |  see through | see-through | seethrough | look through | glassy | like glass | \
         like a window | diaphanous | sheer | see right through",
    ),
    (
        Faint,
        "ghost | ghostly | like a ghost | faint | fainter | barely visible | hardly visible | only just visible | just visible | just about visible |  barely there | nearly invisible | \
         almost invisible | almost transparent | wispy | veil",
    ),
    (Fade, "fade | fade out | fade down | thin out | thin | dissolve | weaken"),
    (More, "more | further | much more | even more"),
    (Less, "less | fewer"),
    (
        Up,
        "up | raise | increase | higher | boost | lift | amplify | turn up | crank up | dial up | stronger light | bring up",
    ),
    (
        Down,
        "down | lower | reduce | decrease | cut down | diminish | lessen | turn down | dial down | tone down | bring down | \
         take down | drop down",
    ),
    (
        Slightly,
        "slightly | a bit | a little | a little bit | a tad | a touch | somewhat | a tiny bit | bit | little bit",
    ),
    (Much, "much | a lot | lots | way | far | considerably | a great deal | strongly | drastically"),
    (Half, "half | halve | halved | semi | halfway | by half"),
    (Double, "double | doubled | twice"),
    (By, "by"),
    (
        Hide,
        "hide | hidden | invisible | not to see anymore | not to see any more | not to see | not see |  remove | removed | conceal | disappear | vanish | get rid of | rid of | lose | off | \
         turn off | switch off | out of the way | out of my way | out of sight | out of view | out of the picture | \
         away | take away | take out | not visible | gone | from view | from sight | suppress | blank | blank out | \
         mask out | don't want to see | do not want to see | don't need to see | don't show | do not show | \
         no longer see | stop showing | unneeded | switched off | turned off | dismiss | clear away | kill | ditch | \
         i don't need | don't display | be without | without seeing | in the way | in my way | blocks my view | \
         is blocking my view | obscures",
    ),
    (
        Show,
        "show | visible | unhide | reveal | bring back | put back | back on | turn on | switch on | turn back on | \
         switch back on | reappear | uncover | be seen | come back | return | in view | on again | visible again",
    ),
    (
        Only,
        "only | alone | nothing but | nothing except | nothing besides | by itself | by themselves | on its own | \
         on their own | isolate | isolated | solo | exclusively | nothing else | and nothing else | in isolation | \
         only leave | leave only | just leave | leave just | keep only | only keep | just show | show just | hide all but",
    ),
    (Nothing, "nothing"),
    (
        Except,
        "except | except for | but | apart from | other than | besides | save | save for | excluding | bar | barring | \
         with the exception of | minus | without | aside from | not including | just not | only not | but not",
    ),
    (
        Light,
        "light | lights | lamp | lighting | illumination | illuminate | lit | shine | shines | spotlight | light source | \
         raking light | grazing light | side light | rim | key light",
    ),
    (
        Headlight,
        "headlight | head light | headlamp | head lamp | camera light | light from the camera | light from my eyes",
    ),
    (Ambient, "ambient | ambient light | base light | fill light"),
    (Diffuse, "diffuse | diffuse light"),
    (
        Specular,
        "specular | highlights | specular highlights | reflections | reflection | glare | gloss | sheen | glints",
    ),
    (Shiny, "shiny | shinier | glossy | glossier | shininess | polished | wet looking"),
    (Bright, "bright | brighter | brighten | brighten up | lighten | lighten up | lighter | brightness"),
    (Dark, "dark | darker | darken | dim | dimmer | gloomy"),
    (Vivid, "vivid | more vivid | saturated | colourful | colorful | vibrant | intense | saturation | punchy | richer"),
    (Dull, "dull | duller | pale | paler | muted | washed out | desaturate | desaturated | greyer | grayer"),
    (Warm, "warm | warmer"),
    (Cool, "cool | cooler | cold | colder"),
    (
        Background,
        "background | backdrop | empty space | the empty space around the model | space around the model | space around it | curtain | \
         wallpaper | emptiness | everything behind | wall |  bg | backround | background colour | background color | canvas | \
         what is behind the volume | what 's behind the volume | what is behind everything | what 's behind everything | \
         what is behind it | what 's behind it | what is behind | what 's behind | behind everything | behind the volume | \
         behind the scene | behind the object | wall behind",
    ),
    (Left, "left | left hand | left hand side | leftwards"),
    (Right, "right | right hand | right hand side | rightwards"),
    (Above, "above | overhead | top | over | upper | superior | higher up | from on high | bird 's eye"),
    (
        Below,
        "below | underneath | underside |  beneath | bottom | under | lower left | lower right | inferior | worm 's eye",
    ),
    (Behind, "behind | rear | posterior | backside | other side | far side"),
    (Front, "front | anterior | in front | head on"),
    (Back, "back"),
    (
        View,
        "view | camera | move the camera | move camera | move the eye | move the view | eye | viewpoint | vantage point | perspective | angle | projection | look at | see from | \
         looking | look from | view from | viewed | seen from | point of view | standpoint | position | screen | frontal",
    ),
    (
        Rotate,
        "rotate | spin | orbit | turn round | turn around | turn it round | turn it around | turn the thing | turn the model | turn it so | turn the whole thing | go round | go around | tilt | roll | swing | pan | revolve | turn the head | turn the scene | turn the view",
    ),
    (Degrees, "degree | degrees | deg | °"),
    (
        Nearer,
        "zoom in | zoom | closer | nearer | close up | closeup | magnify | enlarge | go in | get close | step closer | \
         come closer | too far | too far away | bigger on screen | approach | as close | twice as close",
    ),
    (
        Farther,
        "zoom out | farther | further away | farther away | further out | back off | back up | step back | go back a bit | \
         too close | too near | go away | pull back | move back | back away | out a bit | more overview | backwards",
    ),
    (
        Frame,
        "frame | centre | center | centre on | center on | focus on | zoom to | zoom on | zoom in on | zoom into | fill | \
         fills the screen | fill the screen | fit | home in on | fly to | fly in to | fly into | go to | get closer to | \
         take me to | close up of | closeup of | jump to | get close to | move to | in the middle",
    ),
    (
        Best,
        "best view | best side | isn't hidden by anything | is not hidden by anything | isn't hidden | clean look | clean look at | good look | \
         good look at | decent look at | can be seen as well as possible |  best angle | where nothing is in the way | where nothing is in the way of | to where nothing is in the way of | best seen | seen best | best | as well as possible | as good as possible | \
         most favourable | most favorable | optimal | ideal | most informative | least hidden | occluded as little | \
         hidden as little | unobstructed | nothing in the way | nothing is in the way | nothing in the way of | \
         nothing is in the way of | as little as possible | most visible | clearest view | clearest | see best | wherever | \
         most telling | best perspective",
    ),
    (
        Initial,
        "initial view | initial | original view | starting view | start view | default view | home view | home position | \
         how it was | to how it was | the way it was | as it was | when i started | when we started | view we started with | view i started with | where we started | where i started | beginning | first view | \
         at the start | at first | we began with | view at the start | started with",
    ),
    (
        Reset,
        "reset | restore | revert | undo changes to | back to normal | as in the file | original look | default look",
    ),
    (
        Select,
        "select | selected | pick | pick out | grab | choose | mark | pick up | selection to be | the selection to be | \
         i want the selection to be | selection should be | tag | highlight",
    ),
    (Add, "add | include | append | extend"),
    (
        Inverse,
        "other way round | the other way round | the other way around | invert | inverse | not selected | unselected | isn't selected | is not selected",
    ),
    (
        Selection,
        "selection | the selection | my selection | current selection | what i've brushed | what i have brushed",
    ),
    (
        Deselect,
        "deselect | unselect | don't want anything selected | do not want anything selected | nothing selected | nothing should be selected |  clear the selection | clear my selection | drop the selection | drop my selection | \
         no selection | select nothing | forget the selection | empty the selection | cancel the selection",
    ),
    (
        Lock,
        "lock | locked | protect | freeze | fix | secure | protect from changes | protect against changes | against changes",
    ),
    (Unlock, "unlock | unlocked | unprotect | unfreeze | release"),
    (Normals, "normals | normal vectors | surface normals | normal map"),
    (Shading, "term | shading | shading term | component | part of the shading"),
];

/// Nouns for anything; a description can end with one.
pub(super) const HEADS: &str = "one | ones | thing | things | stuff | structure | structures | part | parts | piece | pieces | object | \
     objects | region | regions | material | unit | units | bit | bits | tree | body";

/// Words of looks in a description.
pub(super) const LOOKS: &str = "small | little | tiny | big | large | larger | largest | biggest | huge | smallest | round | long | thin | \
     flat | thick | longest | thinnest | roundest | metal | metallic | soft | hard | outer | inner | elongated | spherical";

/// Words for the whole scene.
pub(super) const EVERYTHING: &str = "everything | all | all of it | all of them | the lot | the whole lot | all units | all structures | \
     all the units | all the structures | every unit | every structure | each unit | all parts | it all | the whole scene | \
     all things | all the things | anything";

/// Words for what was not named.
pub(super) const REST: &str = "everything else | all else | the rest | the others | all others | all the others | the remaining | \
     anything else | all the rest | the other ones | the other units";

/// Pronouns for the last target.
pub(super) const PRONOUNS: &str = "it | them | this | that | these | those";

/// Words before a name.
pub(super) const DETERMINERS: &str = "the | a | an | my | our | your | this | that | these | those | all | both | all the | all of the | \
     both the";
