//! A plain unix socket: the lower bound.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use prost::Message as _;
use sg_proto::scene::{Command, CommandResult};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, BufStream};
use tokio::net::{UnixListener, UnixStream};

use crate::{Link, appears, command, small};

/// Marks a message without an answer.
const ONE_WAY: u32 = 1 << 31;

fn path(folder: &Path) -> PathBuf {
    folder.join("plain.sock")
}

pub(crate) async fn serve(folder: &Path) {
    let listener = UnixListener::bind(path(folder)).unwrap();
    let (stream, _) = listener.accept().await.unwrap();
    let mut stream = BufStream::new(stream);
    let mut heard = 0;
    let mut bytes = Vec::new();
    while let Ok(head) = stream.read_u32().await {
        bytes.resize((head & !ONE_WAY) as usize, 0);
        stream.read_exact(&mut bytes).await.unwrap();
        if head & ONE_WAY != 0 {
            heard += 1;
            continue;
        }
        let request = Command::decode(bytes.as_slice()).unwrap();
        let reply = CommandResult { id: request.id, revision: heard, ..Default::default() }.encode_to_vec();
        stream.write_u32(reply.len() as u32).await.unwrap();
        stream.write_all(&reply).await.unwrap();
        stream.flush().await.unwrap();
    }
}

pub(crate) struct Socket(BufStream<UnixStream>);

impl Socket {
    pub(crate) async fn connect(folder: &Path) -> Self {
        appears(&path(folder)).await;
        Self(BufStream::new(UnixStream::connect(path(folder)).await.unwrap()))
    }

    async fn ask(&mut self, text: &str) -> CommandResult {
        let request = command(text).encode_to_vec();
        self.0.write_u32(request.len() as u32).await.unwrap();
        self.0.write_all(&request).await.unwrap();
        self.0.flush().await.unwrap();
        let mut bytes = vec![0; self.0.read_u32().await.unwrap() as usize];
        self.0.read_exact(&mut bytes).await.unwrap();
        CommandResult::decode(bytes.as_slice()).unwrap()
    }
}

impl Link for Socket {
    async fn echo(&mut self, text: &str) {
        assert_eq!(self.ask(text).await.id.len(), text.len());
    }

    async fn flood(&mut self, time: Duration) -> u64 {
        let before = self.ask("").await.revision;
        let frame = small();
        let begun = Instant::now();
        while begun.elapsed() < time {
            for _ in 0..64 {
                let bytes = frame.encode_to_vec();
                self.0.write_u32(bytes.len() as u32 | ONE_WAY).await.unwrap();
                self.0.write_all(&bytes).await.unwrap();
            }
        }
        self.ask("").await.revision - before
    }
}
