//! What people of a field call the same structure, where the dictionary does not say so.

/// Names of one structure. A name of several structures stands in several rows.
const SAME: [&[&str]; 18] = [
    &["aneurysm", "aneurysm sac", "sac", "dome"],
    &["skull", "cranium", "calvaria", "braincase"],
    &["vessel", "vessels", "vasculature", "vascular tree", "angiogram"],
    &["tumor", "tumour", "mass", "lesion", "neoplasm"],
    &["bone", "bones", "skeleton"],
    &["grey matter", "gray matter", "cortex"],
    &["cerebrospinal fluid", "csf", "ventricle", "ventricles"],
    &["thrombus", "clot", "blood clot"],
    &["calcification", "plaque"],
    &["stone", "calculus", "concretion"],
    &["fat", "adipose tissue", "body fat"],
    &["implant", "prosthesis"],
    &["clip", "metal", "metal clip"],
    &["screw", "metal"],
    &["stent", "metal"],
    &["coil", "metal"],
    &["tissue", "soft tissue", "flesh"],
    &["vessel", "vessels", "arterial tree", "arteries"],
];

/// Other names of a structure, for a term in lower case.
pub(crate) fn other_names(term: &str) -> impl Iterator<Item = &'static str> {
    SAME.iter()
        .filter(move |names| names.contains(&term))
        .flat_map(|names| names.iter().copied())
        .filter(move |name| *name != term)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_one_structure_lead_to_each_other() {
        let names = |term| other_names(term).collect::<Vec<_>>();
        assert!(names("aneurysm").contains(&"sac") && names("sac").contains(&"aneurysm"));
        assert!(names("clot").contains(&"thrombus") && names("csf").contains(&"ventricles"));
        assert!(names("carburettor").is_empty() && !names("sac").contains(&"sac"));
    }
}
