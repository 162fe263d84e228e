//! A file that is dropped on a window as a file manager does it: the source's side of XDND.

use std::path::Path;
use std::time::{Duration, Instant};

use x11rb::connection::Connection as _;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    ClientMessageEvent, ConnectionExt as _, CreateWindowAux, EventMask, PropMode, SELECTION_NOTIFY_EVENT,
    SelectionNotifyEvent, SelectionRequestEvent, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;
use x11rb::{COPY_DEPTH_FROM_PARENT, COPY_FROM_PARENT, CURRENT_TIME};

/// The version of the protocol that is spoken.
const VERSION: u32 = 5;

x11rb::atom_manager! {
    Atoms: AtomsCookie {
        XdndSelection,
        XdndEnter,
        XdndPosition,
        XdndStatus,
        XdndDrop,
        XdndFinished,
        XdndActionCopy,
        URI_LIST: b"text/uri-list",
    }
}

/// The source of a drag.
struct Source {
    connection: RustConnection,
    atoms: Atoms,
    window: u32,
    target: u32,
    list: String,
}

/// Drops a file on a window of a display.
///
/// # Errors
/// The display's message, or that the window does not take it within `patience`.
pub fn drop_file(display: &str, target: u32, path: &Path, patience: Duration) -> Result<(), String> {
    let said = |e: &dyn std::fmt::Display| format!("dropping {}: {e}", path.display());
    let source = Source::open(display, target, path).map_err(|e| said(&e))?;
    let Source { atoms, window, .. } = source;
    let entered = [window, VERSION << 24, atoms.URI_LIST, 0, 0];
    let over = [window, 0, 400 << 16 | 400, CURRENT_TIME, atoms.XdndActionCopy];
    source.send(atoms.XdndEnter, entered).map_err(|e| said(&e))?;
    source.send(atoms.XdndPosition, over).map_err(|e| said(&e))?;
    source.serve(patience, |served, said| served && said == Some(atoms.XdndStatus)).map_err(|e| said(&e))?;
    source.send(atoms.XdndDrop, [window, 0, CURRENT_TIME, 0, 0]).map_err(|e| said(&e))?;
    source.serve(patience, |_, said| said == Some(atoms.XdndFinished)).map_err(|e| said(&e))
}

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

impl Source {
    fn open(display: &str, target: u32, path: &Path) -> Outcome<Self> {
        let (connection, screen) = x11rb::connect(Some(display))?;
        let atoms = Atoms::new(&connection)?.reply()?;
        let root = connection.setup().roots.get(screen).ok_or("no such screen")?.root;
        let window = connection.generate_id()?;
        let (parent, aux) = (COPY_FROM_PARENT, CreateWindowAux::new());
        let (depth, class) = (COPY_DEPTH_FROM_PARENT, WindowClass::INPUT_OUTPUT);
        connection.create_window(depth, window, root, 0, 0, 1, 1, 0, class, parent, &aux)?.check()?;
        connection.set_selection_owner(window, atoms.XdndSelection, CURRENT_TIME)?.check()?;
        // Letters that have a meaning in an address are written by their numbers.
        let plain = |b: u8| b.is_ascii_alphanumeric() || b"/-_.~".contains(&b);
        let bytes = path.as_os_str().as_encoded_bytes();
        let address: String =
            bytes.iter().map(|b| if plain(*b) { char::from(*b).to_string() } else { format!("%{b:02X}") }).collect();
        Ok(Self { connection, atoms, window, target, list: format!("file://{address}\r\n") })
    }

    fn send(&self, what: u32, data: [u32; 5]) -> Outcome<()> {
        let message = ClientMessageEvent::new(32, self.target, what, data);
        self.connection.send_event(false, self.target, EventMask::NO_EVENT, message)?.check()?;
        Ok(())
    }

    /// Offers the file's address to requesters until `done`. `done` receives two facts: whether a requester has asked, and the
    /// target's last message.
    fn serve(&self, patience: Duration, done: impl Fn(bool, Option<u32>) -> bool) -> Outcome<()> {
        let begun = Instant::now();
        let (mut served, mut said) = (false, None);
        while !done(served, said) {
            match self.connection.poll_for_event()? {
                Some(Event::SelectionRequest(asked)) => {
                    self.hand_over(&asked)?;
                    served = true;
                }
                Some(Event::ClientMessage(message)) => said = Some(message.type_),
                Some(_) => (),
                None if begun.elapsed() > patience => return Err("the window does not take it".into()),
                None => std::thread::sleep(Duration::from_millis(10)),
            }
        }
        Ok(())
    }

    fn hand_over(&self, asked: &SelectionRequestEvent) -> Outcome<()> {
        let Self { connection, atoms, list, .. } = self;
        let (to, at) = (asked.requestor, asked.property);
        connection.change_property8(PropMode::REPLACE, to, at, atoms.URI_LIST, list.as_bytes())?.check()?;
        let told = SelectionNotifyEvent {
            response_type: SELECTION_NOTIFY_EVENT,
            sequence: 0,
            time: asked.time,
            requestor: to,
            selection: asked.selection,
            target: asked.target,
            property: at,
        };
        connection.send_event(false, to, EventMask::NO_EVENT, told)?.check()?;
        Ok(())
    }
}
