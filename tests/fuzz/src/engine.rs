//! The engine: libFuzzer changes inputs, and keeps those that reach new code.

#![allow(unsafe_code, reason = "libFuzzer is a library in C++")]

use std::ffi::{CString, c_char, c_int};
use std::sync::OnceLock;

use libfuzzer_sys as _;
use sg_fuzz::{Stage, Target};

unsafe extern "C" {
    /// Runs the engine with the arguments of a command line, and calls back with each input.
    fn LLVMFuzzerRunDriver(
        argc: *mut c_int,
        argv: *mut *mut *mut c_char,
        callback: extern "C" fn(*const u8, usize) -> c_int,
    ) -> c_int;
}

static TARGET: OnceLock<&'static Target> = OnceLock::new();

thread_local! {
    static STAGE: Stage = Stage::open().unwrap_or_else(|e| {
        sg_input::print::status(&format!("no folder for inputs: {e}"));
        std::process::exit(2)
    });
}

/// Runs a target under the engine. Ends the process with the engine's exit status.
pub(crate) fn run(target: &'static Target, arguments: &[&str]) -> Result<String, String> {
    TARGET.set(target).map_err(|_| "the engine runs already".to_owned())?;
    // A panic on any thread is a finding: the engine takes the signal, and writes the input.
    std::panic::set_hook(Box::new(|panic| {
        sg_input::print::status_lines(&format!("{panic}\n{}", std::backtrace::Backtrace::force_capture()));
        std::process::abort();
    }));
    let longest = format!("-max_len={}", target.longest);
    // To merge, the engine starts itself again through a shell, by its first word.
    let program = std::env::current_exe().map_err(|e| e.to_string())?;
    let again = format!("'{}' run {}", program.display(), target.name);
    let words = [again.as_str(), &longest].into_iter().chain(arguments.iter().copied());
    let words: Vec<CString> = words.map(CString::new).collect::<Result<_, _>>().map_err(|e| e.to_string())?;
    let mut pointers: Vec<*mut c_char> = words.iter().map(|word| word.as_ptr().cast_mut()).collect();
    let mut count = c_int::try_from(pointers.len()).map_err(|e| e.to_string())?;
    pointers.push(std::ptr::null_mut());
    let mut list = pointers.as_mut_ptr();
    // SAFETY: the list ends with a null pointer, and its words live until the process ends below.
    let status = unsafe { LLVMFuzzerRunDriver(&raw mut count, &raw mut list, one) };
    std::process::exit(status)
}

extern "C" fn one(data: *const u8, length: usize) -> c_int {
    let Some(target) = TARGET.get() else { return 0 };
    // SAFETY: the engine gives a buffer of this length, which lives during this call. It may be null if it is empty.
    let input = if length == 0 { &[] } else { unsafe { std::slice::from_raw_parts(data, length) } };
    STAGE.with(|stage| target.check(stage, input));
    0
}
