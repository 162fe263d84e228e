//! `contract check`: lint, compatibility with the last release, golden bytes, the key table, and a running stack.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use prost_reflect::{DescriptorPool, Kind as FieldKind};
use sg_input::file;
use sg_input::limits::DATA_BYTES;
use sg_proto::golden::Line;
use sg_proto::keys::{self, Kind, Row, role};
use sg_proto::released;

use super::buf::{self, Buf};
use super::findings::Findings;
use super::{live, structure};
use crate::terminal::{self, CommandResult, Failure};

#[derive(Debug, clap::Args)]
pub(crate) struct CheckArgs {
    /// Compiled schema to compare with; by default the last release
    #[arg(long, value_name = "IMAGE")]
    against: Option<PathBuf>,
    /// Folder of the schema; by default `proto` here or in a parent folder
    #[arg(long, value_name = "DIR")]
    proto: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Most problems of one kind that are listed.
const MAX_LISTED: usize = 20;

pub(super) async fn check(arguments: &CheckArgs, session: Option<&str>) -> CommandResult {
    let mut findings = Findings::default();
    let proto = proto_folder(arguments.proto.clone())?;
    let compiled = pool("the compiled schema", sg_proto::DESCRIPTORS)?;
    let (name, image) = match &arguments.against {
        None => (format!("v{}", released::VERSION), released::IMAGE.to_vec()),
        Some(path) => {
            let read = file::read(path, DATA_BYTES);
            let bytes = read.map_err(|e| Failure::Input(format!("{}: {e}", path.display())))?;
            (path.display().to_string(), bytes)
        }
    };
    let before = pool(&name, &image)?;

    sources(proto.as_deref(), arguments.against.as_deref(), &mut findings).await;
    let summary = format!(
        "{} messages and {} enums are unchanged in the compiled schema",
        before.all_messages().count(),
        before.all_enums().count()
    );
    findings.add_result(format!("structure against {name}"), structure::breaking_changes(&before, &compiled), summary);
    golden(proto.as_deref(), &compiled, &mut findings)?;
    let rows = keys::rows();
    findings.add_result("key table", table(&rows, &compiled), format!("{} rows match the schema", rows.len()));
    if let Some(session) = session {
        live::check_stack(session, &rows, &mut findings).await?;
    }

    if arguments.json {
        terminal::print_line(&findings.as_json().to_string());
    } else {
        findings.print();
    }
    match findings.broken() {
        0 => Ok(()),
        n => Err(Failure::Work(format!("{n} of {} checks of the contract failed", findings.checked()))),
    }
}

fn pool(name: &str, image: &[u8]) -> Result<DescriptorPool, Failure> {
    DescriptorPool::decode(image).map_err(|e| Failure::Input(format!("{name} is not a compiled schema: {e}")))
}

/// The folder of the schema: the named one, or `proto` of the surrounding checkout.
pub(super) fn proto_folder(named: Option<PathBuf>) -> Result<Option<PathBuf>, Failure> {
    let is_schema = |folder: &Path| folder.join("buf.yaml").is_file() && folder.join("supergaussian").is_dir();
    if let Some(folder) = named {
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        return match is_schema(&folder) {
            true => Ok(Some(folder)),
            false => Err(Failure::Input(format!("{}: no schema (buf.yaml, supergaussian/) in it", folder.display()))),
        };
    }
    let here = std::env::current_dir().map_err(|e| Failure::Work(format!("the working folder: {e}")))?;
    Ok(here.ancestors().map(|folder| folder.join("proto")).find(|folder| is_schema(folder)))
}

/// Checks the sources with buf.
async fn sources(proto: Option<&Path>, against: Option<&Path>, findings: &mut Findings) {
    let Some(proto) = proto else {
        findings.skip("buf", "no proto/ here or in a parent folder: only the compiled schema is checked");
        return;
    };
    let Some(buf) = Buf::find(proto) else {
        let absent = "buf is missing (ops/setup-debian.sh installs it): lint, format and FILE rules are not checked";
        if buf::is_required() {
            findings.add_result("buf", vec![absent.to_owned()], "");
        } else {
            findings.skip("buf", absent);
        }
        return;
    };
    let newest = proto.join("released").join(format!("v{}.binpb", released::VERSION));
    let against = against.map_or(newest, |path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned()));
    findings.add_result("buf lint", buf.lint().await, "no complaint");
    findings.add_result("buf format", buf.format().await, "no difference");
    let image = against.file_name().unwrap_or_default().display();
    findings.add_result(
        "buf breaking",
        buf.breaking(&against).await,
        format!("nothing breaks {image} by the FILE rules"),
    );
}

/// Package and content of every golden file, by name.
pub(super) fn golden_files(folder: &Path) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let fail = |e: std::io::Error| Failure::Input(format!("{}: {e}", folder.display()));
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        if let Some(package) = path.file_stem().and_then(|s| s.to_str()).filter(|_| path.is_file()) {
            files.push((package.to_owned(), file::read(&path, DATA_BYTES).map_err(fail)?));
        }
    }
    files.sort();
    Ok(files)
}

/// Golden bytes: released lines are unchanged, and every line still decodes to its meaning.
fn golden(proto: Option<&Path>, compiled: &DescriptorPool, findings: &mut Findings) -> CommandResult {
    let Some(proto) = proto else {
        findings.skip("golden bytes", "no proto/ here or in a parent folder");
        return Ok(());
    };
    let files = golden_files(&proto.join("golden"))?;
    let parts = released::golden_parts().map_err(|e| Failure::Work(e.to_string()))?;
    findings.add_result(
        "golden bytes of the release",
        parts.iter().filter_map(|part| changed_since(part, &files)).collect(),
        format!("{} files begin as in v{}", parts.len(), released::VERSION),
    );
    let mut problems = Vec::new();
    let mut lines = 0;
    for (package, bytes) in &files {
        for (number, text) in String::from_utf8_lossy(bytes).lines().enumerate() {
            lines += 1;
            if let Err(why) = Line::parse(text).and_then(|line| line.check(compiled).map(drop)) {
                problems.push(format!("{package}.txt:{}: {why}", number + 1));
            }
        }
    }
    let more = problems.len().saturating_sub(MAX_LISTED);
    problems.truncate(MAX_LISTED);
    if more > 0 {
        problems.push(format!("and {more} more lines"));
    }
    findings.add_result("golden bytes", problems, format!("{lines} lines still decode to their meaning"));
    Ok(())
}

fn changed_since(part: &released::GoldenPart, files: &[(String, Vec<u8>)]) -> Option<String> {
    let file = files.iter().find(|(package, _)| package == part.package).map(|(_, bytes)| bytes);
    let Some(file) = file else { return Some(format!("{}.txt is gone", part.package)) };
    match file.get(..part.bytes) {
        Some(then) if blake3::hash(then).to_hex().as_str() == part.hash => None,
        _ => Some(format!(
            "{}.txt: released lines of v{} were changed or deleted; append new lines at the end",
            part.package,
            released::VERSION
        )),
    }
}

/// Messages without a row: the attachment of every payload, and the error reply.
const BESIDE_THE_TABLE: [&str; 2] = ["supergaussian.bus.v1.Envelope", "supergaussian.bus.v1.Error"];

/// Mismatches between the key table and the schema, in both directions.
fn table(rows: &[Row], pool: &DescriptorPool) -> Vec<String> {
    let mut problems = Vec::new();
    let mut seen = BTreeSet::new();
    let mut used: BTreeSet<String> = BESIDE_THE_TABLE.iter().map(|name| (*name).to_owned()).collect();
    for row in rows {
        let place = format!("{}/{}", row.role, row.name);
        if !seen.insert((row.role, row.name)) {
            problems.push(format!("{place} stands twice"));
        }
        for role in row.senders.iter().chain([&row.role]) {
            if *role != keys::ANY && !role::ALL.contains(role) {
                problems.push(format!("{place}: `{role}` is not a role"));
            }
        }
        for name in messages_of(row) {
            if pool.get_message_by_name(name).is_none() {
                problems.push(format!("{place}: {name} is not in the schema"));
            }
            used.insert(name.to_owned());
        }
    }
    // A field of another message or a gRPC service is a use too.
    for message in pool.all_messages() {
        for field in message.fields() {
            if let FieldKind::Message(inner) = field.kind() {
                used.insert(inner.full_name().to_owned());
            }
        }
    }
    for method in pool.services().flat_map(|s| s.methods().collect::<Vec<_>>()) {
        used.insert(method.input().full_name().to_owned());
        used.insert(method.output().full_name().to_owned());
    }
    let ours = pool.all_messages().filter(|m| m.package_name().starts_with("supergaussian."));
    let idle = ours.filter(|m| !used.contains(m.full_name()));
    problems.extend(idle.map(|m| format!("{} belongs to no key and no message", m.full_name())));
    problems
}

/// Full names of the messages of a row.
pub(super) fn messages_of(row: &Row) -> Vec<&str> {
    match &row.kind {
        Kind::Request { request, reply } => vec![request, reply],
        Kind::Stream { message } | Kind::Retained { message } => vec![message],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn key_table_matches_the_schema() {
        let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS).unwrap();
        let mut rows = keys::rows();
        assert_eq!(table(&rows, &pool), Vec::<String>::new());

        rows.retain(|row| row.name != "cmd/parse");
        let idle = table(&rows, &pool);
        assert_eq!(idle, ["supergaussian.language.v1.IntentRequest belongs to no key and no message"]);

        let ready = rows.iter_mut().find(|row| row.name == "event/ready").unwrap();
        ready.kind = Kind::Stream { message: "supergaussian.bus.v2.Ready".to_owned() };
        assert!(table(&rows, &pool).iter().any(|c| c.contains("v2.Ready is not in the schema")));
        let again = rows[0].clone();
        rows.push(again);
        assert!(table(&rows, &pool).iter().any(|c| c.ends_with("stands twice")));
    }

    #[test]
    fn golden_files_may_only_grow() {
        let part =
            released::GoldenPart { package: "a", bytes: 4, hash: blake3::hash(b"one\n").to_hex().to_string().leak() };
        let told = |text: &str| changed_since(&part, &[("a".to_owned(), text.as_bytes().to_vec())]);
        assert_eq!(told("one\n"), None);
        assert_eq!(told("one\ntwo\n"), None);
        assert!(told("two\none\n").unwrap().contains("changed or deleted"));
        assert!(told("one").unwrap().contains("changed or deleted"));
        assert!(changed_since(&part, &[]).unwrap().contains("gone"));
    }
}
