//! A window that is minimised and shown again as a window manager does it (EWMH and ICCCM).

use x11rb::connection::Connection as _;
use x11rb::protocol::xproto::{AtomEnum, ConnectionExt as _, PropMode};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

x11rb::atom_manager! {
    Atoms: AtomsCookie {
        _NET_WM_STATE,
        _NET_WM_STATE_HIDDEN,
    }
}

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn open(display: &str) -> Result<(RustConnection, Atoms), Box<dyn std::error::Error>> {
    let (connection, _) = x11rb::connect(Some(display))?;
    let atoms = Atoms::new(&connection)?.reply()?;
    Ok((connection, atoms))
}

/// Marks a window as hidden and takes it from the screen.
pub(crate) fn minimize(display: &str, window: u32) -> Outcome {
    let (connection, atoms) = open(display)?;
    let hidden = [atoms._NET_WM_STATE_HIDDEN];
    connection.change_property32(PropMode::REPLACE, window, atoms._NET_WM_STATE, AtomEnum::ATOM, &hidden)?.check()?;
    connection.unmap_window(window)?.check()?;
    Ok(connection.flush()?)
}

/// Puts a window on the screen again.
pub(crate) fn restore(display: &str, window: u32) -> Outcome {
    let (connection, atoms) = open(display)?;
    connection.delete_property(window, atoms._NET_WM_STATE)?.check()?;
    connection.map_window(window)?.check()?;
    Ok(connection.flush()?)
}
