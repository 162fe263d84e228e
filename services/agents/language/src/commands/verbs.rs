//! Opening phrases that several commands share.

pub(super) const MAKE: &str = "make | turn | set | change | render | draw | show | show me | display | give | i want | i'd like | \
 i would like | keep | leave | put | switch | have | let | (none)";

pub(super) const PAINT: &str = "colour | color | paint | recolour | recolor | repaint | tint | dye | stain | highlight | fill | \
 shade";

pub(super) const SET: &str = "set | change | make | put | bring | turn | switch | adjust | use | give | (none)";

pub(super) const INCREASE: &str =
    "increase | raise | boost | double | triple | turn up | strengthen | crank up | bump up | dial up";

pub(super) const DECREASE: &str = "decrease | reduce | lower | halve | drop | cut | turn down | weaken | dial down";

pub(super) const SHOW: &str = "show | show me | display | reveal | unhide | bring back | bring up | turn on | switch on | \
 turn back on | let me see | can i see | could i see | may i see | i want to see | i'd like to see | \
 i would like to see | see | uncover | draw";
