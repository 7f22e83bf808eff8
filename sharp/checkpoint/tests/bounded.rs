//! Hostile files are rejected without large allocations; every allocation is counted.

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs::{self, File};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use sharp_checkpoint::Checkpoint;
use sharp_tests::hostile_checkpoints;

struct Counting;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let live = LIVE.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(live, Relaxed);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Peak number of bytes allocated while the file is opened and, if it can be opened, read.
fn peak(path: &Path) -> usize {
    let before = LIVE.load(Relaxed);
    PEAK.store(before, Relaxed);
    if let Ok(found) = Checkpoint::open(path) {
        for name in found.names() {
            drop(found.tensor_f32(name));
        }
    }
    PEAK.load(Relaxed) - before
}

// A single test, so that no other test allocates at the same time.
#[test]
fn hostile_files_allocate_little() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("hostile.pt");
    for (what, bytes) in hostile_checkpoints::all() {
        fs::write(&path, &bytes).unwrap();
        assert!(Checkpoint::open(&path).is_err(), "{what}");
        let peak = peak(&path);
        assert!(peak < 96 << 20, "{what}: {peak} bytes");
    }
    // Sparse files of 64 GiB: first a single endless pickle, then a single endless header.
    for start in [
        hostile_checkpoints::older(b"\x80\x02"),
        vec![0, 0, 0, 0, 8, 0, 0, 0, b'{'],
    ] {
        fs::write(&path, &start).unwrap();
        File::options()
            .write(true)
            .open(&path)
            .unwrap()
            .set_len(64 << 30)
            .unwrap();
        let peak = peak(&path);
        assert!(peak < 1 << 20, "{peak} bytes");
    }
}
