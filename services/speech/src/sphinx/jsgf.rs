//! The grammar of `pocketsphinx`: JSpeech Grammar Format (W3C note of 2000).

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::phrases::{Node, PhraseGrammar};

/// The grammar in JSGF, of the words that `sayable` accepts. `None` if no sentence is left.
pub(super) fn jsgf(grammar: &PhraseGrammar, sayable: &impl Fn(&str) -> bool) -> Option<String> {
    // Names of slots are the caller's, so rules are numbered.
    let mut rules = BTreeMap::new();
    let mut text = String::from("#JSGF V1.0 UTF-8;\ngrammar commands;\n");
    for (name, values) in grammar.slots() {
        let values: Vec<String> = values.iter().filter_map(|value| node(value, &rules, sayable)).collect();
        if !values.is_empty() {
            let rule = format!("<slot{}>", rules.len());
            let _ = writeln!(text, "{rule} = {};", values.join(" | "));
            rules.insert(name.to_owned(), rule);
        }
    }
    let templates: Vec<String> =
        grammar.templates().filter_map(|template| sequence(template, &rules, sayable)).collect();
    let templates: Vec<&String> = templates.iter().filter(|template| !template.is_empty()).collect();
    if templates.is_empty() {
        return None;
    }
    text.push_str("public <command> =");
    for (k, template) in templates.iter().enumerate() {
        let _ = write!(text, "{}{template}", if k == 0 { "\n  " } else { "\n  | " });
    }
    text.push_str(";\n");
    Some(text)
}

fn sequence(nodes: &[Node], rules: &BTreeMap<String, String>, sayable: &impl Fn(&str) -> bool) -> Option<String> {
    let parts: Option<Vec<String>> = nodes.iter().map(|each| node(each, rules, sayable)).collect();
    Some(parts?.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" "))
}

fn node(node: &Node, rules: &BTreeMap<String, String>, sayable: &impl Fn(&str) -> bool) -> Option<String> {
    match node {
        Node::Text { spoken, .. } => spoken.iter().all(|word| sayable(word)).then(|| spoken.join(" ")),
        Node::Slot(name) => rules.get(name).cloned(),
        Node::Choice(choices) => {
            let parts: Vec<String> = choices.iter().filter_map(|choice| sequence(choice, rules, sayable)).collect();
            let texts: Vec<&str> = parts.iter().map(String::as_str).filter(|part| !part.is_empty()).collect();
            let joined = texts.join(" | ");
            match (texts.is_empty(), parts.len() > texts.len()) {
                (true, true) => Some(String::new()),
                (true, false) => None,
                (false, true) => Some(format!("[ {joined} ]")),
                (false, false) => Some(format!("( {joined} )")),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grammar() -> PhraseGrammar {
        let mut grammar = PhraseGrammar::new();
        grammar.set_slot("unit", ["sac", "left_kidney-2", "qqq"]).unwrap();
        grammar.set_slot("empty", ["qqq"]).unwrap();
        for template in
            ["[please] hide (the | this) {unit}", "fade to 20 %", "qqq now", "open {empty}", "[go] [on]", "…"]
        {
            grammar.add(template).unwrap();
        }
        grammar
    }

    #[test]
    fn a_grammar_keeps_only_what_can_be_said() {
        let text = jsgf(&grammar(), &|word| word != "qqq").unwrap();
        let expected = "#JSGF V1.0 UTF-8;\ngrammar commands;\n<slot0> = sac | left kidney two;\npublic <command> =\n  \
                        [ please ] hide ( the | this ) <slot0>\n  | fade to twenty percent\n  | [ go ] [ on ];\n";
        assert_eq!(text, expected);
        assert_eq!(jsgf(&grammar(), &|_| false), None);
        assert_eq!(jsgf(&PhraseGrammar::new(), &|_| true), None);
    }
}
