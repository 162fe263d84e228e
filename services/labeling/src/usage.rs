//! What people of a field call the same structure, where the dictionary does not say so.

/// Names of one structure. Each stands in one row.
const SAME: [&[&str]; 26] = [
    &["aneurysm", "aneurysm sac", "sac", "dome", "pouch"],
    &["skull", "cranium", "calvaria", "braincase", "head bone"],
    &["vessel", "vessels", "vasculature", "vascular tree", "angiogram"],
    &["tumor", "tumour", "mass", "lesion", "neoplasm", "growth"],
    &["bone", "bones", "skeleton", "bony structure"],
    &["soft tissue", "soft tissues", "tissue", "flesh"],
    &["grey matter", "gray matter", "cortex"],
    &["cerebrospinal fluid", "csf", "ventricle", "ventricles"],
    &["thrombus", "clot", "blood clot", "embolus"],
    &["calcification", "plaque", "calcium"],
    &["stone", "calculus", "concretion", "kidney stone"],
    &["effusion", "fluid", "liquid"],
    &["muscle", "muscles", "flesh", "meat"],
    &["fat", "adipose tissue", "body fat"],
    &["implant", "prosthesis", "hardware"],
    &["clip", "clamp"],
    &["filament", "strand", "fibre", "fiber", "thread"],
    &["void", "cavity", "hole", "pore", "bubble"],
    &["halo", "clump", "cluster"],
    &["shell", "shock", "shock front", "blast wave"],
    &["trunk", "stem"],
    &["foliage", "leaves", "crown"],
    &["soil", "ground", "earth", "dirt"],
    &["pot", "planter", "flowerpot"],
    &["pulp", "root canal", "nerve"],
    &["airway", "airways", "windpipe", "trachea"],
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
        assert!(names("flesh").contains(&"muscle") && names("flesh").contains(&"tissue"));
        assert!(names("carburettor").is_empty() && !names("sac").contains(&"sac"));
    }
}
