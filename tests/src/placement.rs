//! Where a window lies on the screen, inside the frame that its window manager gives it.

use x11rb::connection::Connection as _;
use x11rb::protocol::xproto::ConnectionExt as _;

/// Left, top, width and height of a window's content on the screen, pixels.
///
/// `xdotool getwindowgeometry` counts the window's place in its frame twice.
pub(crate) fn place(display: &str, window: u32) -> Result<[i32; 4], Box<dyn std::error::Error>> {
    let (connection, screen) = x11rb::connect(Some(display))?;
    let root = connection.setup().roots.get(screen).ok_or("the display has no screen")?.root;
    let size = connection.get_geometry(window)?.reply()?;
    let at = connection.translate_coordinates(window, root, 0, 0)?.reply()?;
    Ok([at.dst_x.into(), at.dst_y.into(), size.width.into(), size.height.into()])
}
