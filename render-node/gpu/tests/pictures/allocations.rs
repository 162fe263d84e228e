//! Counts the heap allocations of one thread.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// Heap allocations, reallocations included.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Allocations {
    pub(crate) count: u64,
    pub(crate) bytes: u64,
    /// Bytes of the largest one.
    pub(crate) largest: u64,
}

impl Allocations {
    /// The largest numbers of both.
    pub(crate) fn max(self, other: Self) -> Self {
        Self {
            count: self.count.max(other.count),
            bytes: self.bytes.max(other.bytes),
            largest: self.largest.max(other.largest),
        }
    }
}

thread_local! {
    static COUNTED: Cell<Allocations> = const { Cell::new(Allocations { count: 0, bytes: 0, largest: 0 }) };
}

struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn count(bytes: usize) {
    // A thread that ends has no cell any more; nobody asks for its number.
    let _ = COUNTED.try_with(|counted| {
        let Allocations { count, bytes: before, largest } = counted.get();
        let bytes = bytes as u64;
        counted.set(Allocations { count: count + 1, bytes: before + bytes, largest: largest.max(bytes) });
    });
}

// SAFETY: every call goes to the system's allocator with the caller's own arguments; counting does not allocate.
#[allow(unsafe_code, reason = "an allocator is unsafe by its interface")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        unsafe { System.realloc(pointer, layout, size) }
    }
}

/// The allocations of this thread during `work`.
pub(crate) fn during<T>(work: impl FnOnce() -> T) -> (T, Allocations) {
    COUNTED.set(Allocations::default());
    let outcome = work();
    (outcome, COUNTED.get())
}

#[test]
fn allocations_of_this_thread_are_counted() {
    let (_, none) = during(|| std::hint::black_box([1; 64]));
    assert_eq!(none, Allocations::default());
    let ((), some) = during(|| {
        let mut rows = std::hint::black_box(Vec::<u8>::with_capacity(100));
        rows.resize(300, 1);
        std::thread::scope(|scope| drop(scope.spawn(|| std::hint::black_box(vec![1_u8; 1 << 20])).join()));
        std::hint::black_box(rows);
    });
    // The thread itself takes some.
    assert!(some.count >= 2 && some.bytes >= 400 && (300..1 << 20).contains(&some.largest), "{some:?}");
}
