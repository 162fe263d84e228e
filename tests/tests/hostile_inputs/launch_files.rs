//! Launch files and scripts with very many parts.

use crate::case::{Case, Ending};
use crate::readers;

fn one(reader: &str, name: &str, text: String) -> Case {
    let reader = readers::named(reader);
    reader.case("launch files", name, &reader.file()).bytes(&reader.file(), text).ending(Ending::Mistakes)
}

pub(crate) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let service = |i: usize| format!("[service.s{i}]\nexec = \"/bin/true\"\n");
    let services = |count: usize| "schema = 1\n".to_owned() + &(0..count).map(service).collect::<String>();
    cases.push(one("launch", "20,000 services", services(20_000)));
    cases.push(one("launch", "20,000 services on one line", {
        let inline: Vec<String> = (0..20_000).map(|i| format!("s{i}={{exec=\"/bin/true\"}}")).collect();
        format!("schema = 1\nservice = {{ {} }}\n", inline.join(", "))
    }));
    cases.push(one("launch", "256 services in a circle", {
        let names: Vec<String> = (0..256).map(|i| format!("s{i} = \"ready\"")).collect();
        let one = |i: usize| format!("[service.s{i}]\nexec = \"/bin/true\"\nafter = {{ {} }}\n", names.join(", "));
        "schema = 1\n".to_owned()
            + &(0..100).map(one).collect::<String>()
            + &(100..256).map(service).collect::<String>()
    }));
    cases.push(one("launch", "20,000 conditions", {
        let names: Vec<String> = (0..20_000).map(|i| format!("x{i} = \"ready\"")).collect();
        format!("{}after = {{ {} }}\n", services(200), names.join(", "))
    }));
    cases.push(one("launch", "a condition of a long name", {
        let name = "x".repeat(400_000);
        format!("schema = 1\n[service.{name}]\nexec = \"/bin/true\"\nafter = {{ {name}y = \"ready\" }}\n")
    }));
    cases.push(one("launch", "40,000 unknown keys", {
        let keys: String = (0..40_000).map(|i| format!("key{i} = 1\n")).collect();
        format!("schema = 1\n[service.a]\nexec = \"/bin/true\"\n{keys}")
    }));
    cases.push(one("launch", "50,000 variables", {
        let env: String = (0..50_000).map(|i| format!("v{i} = \"\"\n")).collect();
        format!(
            "schema = 1\n[defaults.env]\n{env}[service.a]\nexec = 3\n[service.a.env]\n{}",
            env.replace("\"\"", "\"x\"")
        )
    }));
    cases.push(one("launch", "200 services of one role", {
        let one = |i: usize| format!("[service.s{i}]\nexec = \"/bin/true\"\nrole = \"scene\"\n");
        "schema = 1\n".to_owned() + &(0..200).map(one).collect::<String>()
    }));
    cases.push(one("launch", "256 executables that are not there", {
        let one = |i: usize| format!("[service.s{i}]\nexec = \"supergaussian-n{i}\"\n");
        "schema = 1\n".to_owned() + &(0..256).map(one).collect::<String>()
    }));
    cases.push(one("launch", "10,000 nodes", {
        let node = |i: usize| format!("[node.n{i}]\nlease = 1\n");
        services(1) + &(0..10_000).map(node).collect::<String>()
    }));
    cases.push(one("launch", "two megabytes", services(1) + &"# a\n".repeat(1 << 19)));
    cases.push(one(
        "launch",
        "many line ends before a mistake",
        "schema = 1\n".to_owned() + &"\n".repeat(900_000) + "x = 1\n",
    ));
    let step = |text: &str, count: usize| format!("[[step]]\n{text}\n").repeat(count);
    cases.push(one("script", "5,000 steps", step("say = \"help\"", 5000)));
    cases.push(one("script", "5,000 pictures of one name", step("capture = \"a\"", 5000)));
    cases.push(one("script", "5,000 steps without an action", step("sya = \"help\"", 5000)));
    cases.push(one("script", "5,000 steps on one line", {
        format!("step = [{}]\n", vec!["{say=\"help\"}"; 5000].join(", "))
    }));
    let strokes = readers::named("script");
    cases.push(
        strokes
            .case("launch files", "900 steps of one bad stroke file", &strokes.file())
            .bytes(&strokes.file(), step("strokes = \"s.json\"", 900))
            .bytes("s.json", readers::strokes(2000)),
    );
    cases
}
