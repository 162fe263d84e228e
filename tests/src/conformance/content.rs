//! Large content, as other machines request it: part by part, by its hash.

use sg_proto::bus::{Code, ContentReply, ContentRequest};
use sg_proto::keys::Request;

use super::question::{hold, soon};
use super::stage::Stage;

/// Most parts that are requested.
const PARTS: usize = 10_000;

/// All of something, checked against its hash.
pub(super) async fn whole(
    stage: &Stage<'_>,
    row: &Request<ContentRequest, ContentReply>,
    hash: &str,
) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    for _ in 0..PARTS {
        let request = ContentRequest { hash: hash.to_owned(), offset: bytes.len() as u64 };
        let part = stage.cli.ask(row, &request, &soon()).await.map_err(|f| format!("{}: {f}", row.name))?;
        bytes.extend_from_slice(&part.data);
        if part.data.is_empty() || bytes.len() as u64 >= part.total {
            break;
        }
    }
    let found = blake3::hash(&bytes).to_hex();
    hold(found.as_str() == hash, || format!("what is sent under {hash} has hash {found}"))?;
    Ok(bytes)
}

/// Content that is not offered is not sent.
pub(super) async fn unknown(stage: &Stage<'_>, row: &Request<ContentRequest, ContentReply>) -> Result<(), String> {
    for hash in ["", "../scene.toml", "/etc/passwd", &"0".repeat(64)] {
        let request = ContentRequest { hash: hash.to_owned(), offset: 0 };
        let code = stage.cli.ask(row, &request, &soon()).await.err().map(|f| f.code);
        hold(code == Some(Code::NotFound), || format!("asked for `{hash}`: {code:?}"))?;
    }
    Ok(())
}
