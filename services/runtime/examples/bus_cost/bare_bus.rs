//! Plain zenoh over the same router and link, with the same encoded messages.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use prost::Message as _;
use sg_proto::scene::{Command, CommandResult};
use sg_runtime::bus::endpoint_of;
use zenoh::Wait as _;

use crate::{Link, command, small};

const ECHO: &str = "bare/echo";
const STREAM: &str = "bare/stream";

async fn join(folder: &Path) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    let endpoint = format!("[\"{}\"]", endpoint_of(&folder.join("bus.sock")));
    for (key, value) in [
        ("mode", "\"client\""),
        ("connect/endpoints", &endpoint),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
    ] {
        config.insert_json5(key, value).unwrap();
    }
    zenoh::open(config).await.unwrap()
}

pub(crate) async fn serve(folder: &Path) {
    let session = join(folder).await;
    let heard = Arc::new(AtomicU64::new(0));
    let counter = Arc::clone(&heard);
    let _stream = session
        .declare_subscriber(STREAM)
        .callback(move |_| {
            counter.fetch_add(1, Ordering::Relaxed);
        })
        .await
        .unwrap();
    let echo = session.declare_queryable(ECHO).await.unwrap();
    while let Ok(query) = echo.recv_async().await {
        let request = Command::decode(&*query.payload().unwrap().to_bytes()).unwrap();
        let revision = heard.load(Ordering::Relaxed);
        let reply = CommandResult { id: request.id, revision, ..Default::default() };
        query.reply(ECHO, reply.encode_to_vec()).await.unwrap();
    }
}

pub(crate) struct BareBus(zenoh::Session);

impl BareBus {
    pub(crate) async fn connect(folder: &Path) -> Self {
        let link = Self(join(folder).await);
        // Without a server there is no reply.
        while link.ask("ready?").await.is_none() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        link
    }

    async fn ask(&self, text: &str) -> Option<CommandResult> {
        let replies = self.0.get(ECHO).payload(command(text).encode_to_vec()).await.unwrap();
        let reply = replies.recv_async().await.ok()?;
        Some(CommandResult::decode(&*reply.result().unwrap().payload().to_bytes()).unwrap())
    }
}

impl Link for BareBus {
    async fn echo(&mut self, text: &str) {
        assert_eq!(self.ask(text).await.unwrap().id.len(), text.len());
    }

    async fn flood(&mut self, time: Duration) -> u64 {
        let before = self.ask("").await.unwrap().revision;
        let frame = small();
        let begun = Instant::now();
        while begun.elapsed() < time {
            for _ in 0..64 {
                self.0.put(STREAM, frame.encode_to_vec()).wait().unwrap();
            }
        }
        self.ask("").await.unwrap().revision - before
    }
}
