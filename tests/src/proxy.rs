//! A TCP proxy that imitates the faults of networks: delay, stall, reset, cut, heal.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinHandle;

/// Bytes that are read at once.
const CHUNK: usize = 16 << 10;
/// Chunks on their way in one direction; more wait at their source, as in any network.
const UNDER_WAY: usize = 256;

/// The behaviour of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weather {
    /// All traffic passes, this much later.
    Delay(Duration),
    /// Nothing passes, and neither side is notified.
    Stall,
    /// No peer is connected, and each attempt is refused.
    Cut,
}

/// State shared by all connections.
#[derive(Debug, Clone, Copy)]
struct Sky {
    weather: Weather,
    /// Connections of an older one are reset.
    generation: u64,
}

/// A proxy. Connections through it end with it.
#[derive(Debug)]
pub struct Proxy {
    sky: watch::Sender<Sky>,
    connections: Arc<AtomicU64>,
    accepting: JoinHandle<()>,
}

impl Proxy {
    /// Listens at one address and passes everything on to another, without delay at first.
    ///
    /// # Errors
    /// The address cannot be listened to.
    pub async fn open(listen: SocketAddr, to: SocketAddr) -> std::io::Result<Self> {
        let listener = TcpListener::bind(listen).await?;
        let (sky, seen) = watch::channel(Sky { weather: Weather::Delay(Duration::ZERO), generation: 0 });
        let connections = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&connections);
        let accepting = tokio::spawn(async move {
            while let Ok((stream, _)) = listener.accept().await {
                if seen.borrow().weather == Weather::Cut {
                    reset(&stream);
                    continue;
                }
                counted.fetch_add(1, Ordering::Relaxed);
                tokio::spawn(connect(stream, to, seen.clone()));
            }
        });
        Ok(Self { sky, connections, accepting })
    }

    /// Connections that were let through so far.
    #[must_use]
    pub fn connections(&self) -> u64 {
        self.connections.load(Ordering::Relaxed)
    }

    /// Changes the behaviour of the network. A cut resets the connections.
    pub fn set(&self, weather: Weather) {
        self.sky.send_modify(|sky| {
            sky.weather = weather;
            sky.generation += u64::from(weather == Weather::Cut);
        });
    }

    /// Resets the connections; new ones are let through.
    pub fn reset(&self) {
        self.sky.send_modify(|sky| sky.generation += 1);
    }

    /// Everything passes without delay.
    pub fn heal(&self) {
        self.set(Weather::Delay(Duration::ZERO));
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.accepting.abort();
        self.reset();
    }
}

/// Ends a connection the hard way: the other end gets an error, not an end of stream.
fn reset(stream: &TcpStream) {
    // A stream that is gone needs no reset.
    let _ = stream.set_zero_linger();
}

async fn connect(near: TcpStream, to: SocketAddr, sky: watch::Receiver<Sky>) {
    let Ok(far) = TcpStream::connect(to).await else { return reset(&near) };
    reset(&near);
    reset(&far);
    let generation = sky.borrow().generation;
    let ((near_in, near_out), (far_in, far_out)) = (near.into_split(), far.into_split());
    let mut end = sky.clone();
    tokio::select! {
        // Either side's end is the end of both: the protocols that pass here do not close halves.
        () = pump(near_in, far_out, sky.clone()) => {}
        () = pump(far_in, near_out, sky) => {}
        _ = end.wait_for(|sky| sky.generation != generation) => {}
    }
}

/// Passes bytes on in one direction, each chunk when it is due.
async fn pump(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, mut sky: watch::Receiver<Sky>) {
    let mut under_way: VecDeque<(Instant, Vec<u8>)> = VecDeque::new();
    let mut chunk = vec![0; CHUNK];
    loop {
        let weather = sky.borrow_and_update().weather;
        let due = match (weather, under_way.front()) {
            (Weather::Delay(delay), Some((at, _))) => Some(*at + delay),
            _ => None,
        };
        tokio::select! {
            read = from.read(&mut chunk), if under_way.len() < UNDER_WAY => match read {
                Ok(length) if length > 0 => {
                    under_way.push_back((Instant::now(), chunk.get(..length).unwrap_or_default().to_vec()));
                }
                _ => return,
            },
            () = sleep_until(due) => {
                let Some((_, bytes)) = under_way.pop_front() else { continue };
                if to.write_all(&bytes).await.is_err() {
                    return;
                }
            }
            changed = sky.changed() => if changed.is_err() { return },
        }
    }
}

async fn sleep_until(due: Option<Instant>) {
    match due {
        Some(due) => tokio::time::sleep_until(due.into()).await,
        None => std::future::pending().await,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An echo server behind a proxy.
    async fn echo() -> (Proxy, SocketAddr) {
        let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let to = server.local_addr().unwrap();
        tokio::spawn(async move {
            while let Ok((mut stream, _)) = server.accept().await {
                tokio::spawn(async move {
                    let (mut from, mut back) = stream.split();
                    let _ = tokio::io::copy(&mut from, &mut back).await;
                });
            }
        });
        let free = TcpListener::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap();
        (Proxy::open(free, to).await.unwrap(), free)
    }

    async fn turn(stream: &mut TcpStream) -> std::io::Result<Duration> {
        let begun = Instant::now();
        stream.write_all(b"hello").await?;
        let mut back = [0; 5];
        stream.read_exact(&mut back).await?;
        assert_eq!(&back, b"hello");
        Ok(begun.elapsed())
    }

    #[tokio::test]
    async fn it_delays_stalls_resets_cuts_and_heals() {
        let (proxy, address) = echo().await;
        let mut stream = TcpStream::connect(address).await.unwrap();
        turn(&mut stream).await.unwrap();
        proxy.set(Weather::Delay(Duration::from_millis(30)));
        assert!(turn(&mut stream).await.unwrap() >= Duration::from_millis(60));

        proxy.set(Weather::Stall);
        let late = tokio::time::timeout(Duration::from_millis(100), turn(&mut stream)).await;
        assert!(late.is_err(), "nothing passes");
        proxy.heal();
        // Bytes that were under way arrive.
        let mut back = [0; 5];
        stream.read_exact(&mut back).await.unwrap();

        proxy.reset();
        let mut gone = [0; 1];
        assert!(stream.read_exact(&mut gone).await.is_err());
        let mut stream = TcpStream::connect(address).await.unwrap();
        turn(&mut stream).await.unwrap();

        proxy.set(Weather::Cut);
        assert!(stream.read_exact(&mut gone).await.is_err());
        if let Ok(mut refused) = TcpStream::connect(address).await {
            assert!(turn(&mut refused).await.is_err());
        }
        proxy.heal();
        turn(&mut TcpStream::connect(address).await.unwrap()).await.unwrap();
        assert_eq!(proxy.connections(), 3);
    }
}
