//! Staging memory for the changes that frames send to buffers, made once. wgpu itself makes and frees such memory for every
//! write.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::created::count_created;

/// Bytes of one piece of staging memory.
const CHUNK: u64 = 1 << 20;

/// Limit of the pieces.
const MAX_CHUNKS: u64 = 128;

/// Alignment of mapped ranges, bytes.
const ALIGNMENT: u64 = wgpu::MAP_ALIGNMENT;

/// A piece of staging memory.
#[derive(Debug)]
struct Chunk {
    buffer: wgpu::Buffer,
    /// Whether it is mapped: no submission reads it.
    is_free: Arc<AtomicBool>,
    /// Bytes that the next submission copies.
    used: u64,
}

/// A copy that the next submission makes first.
#[derive(Debug)]
struct PendingCopy {
    from: (wgpu::Buffer, u64),
    to: (wgpu::Buffer, u64),
    bytes: u64,
}

/// Staging memory, with the changes of the next submission.
#[derive(Debug, Default)]
pub(super) struct Uploads {
    chunks: Vec<Chunk>,
    copies: Vec<PendingCopy>,
}

impl Uploads {
    /// Makes room for so many bytes of changes in the submissions that the device has not completed.
    pub(super) fn reserve(&mut self, device: &wgpu::Device, bytes: u64) {
        let wanted = (bytes.div_ceil(CHUNK) + 1).min(MAX_CHUNKS) as usize;
        while self.chunks.len() < wanted {
            count_created(|created| created.buffers += 1);
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("uploads"),
                size: CHUNK,
                usage: wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: true,
            });
            self.chunks.push(Chunk { buffer, is_free: Arc::new(AtomicBool::new(true)), used: 0 });
        }
    }

    /// Takes in a change of a buffer from byte `offset` on. Returns whether there was room for all of it.
    pub(super) fn stage(&mut self, target: &wgpu::Buffer, offset: u64, mut bytes: &[u8]) -> bool {
        let aligned = |n: u64| n.is_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
        if !aligned(offset) || !aligned(bytes.len() as u64) {
            return false;
        }
        let free = self.chunks.iter().filter(|c| c.is_free.load(Ordering::Acquire));
        if free.map(|c| CHUNK - c.used).sum::<u64>() < bytes.len() as u64 {
            return false;
        }
        let mut to = offset;
        for chunk in &mut self.chunks {
            let length = (CHUNK - chunk.used).min(bytes.len() as u64);
            if length == 0 || !chunk.is_free.load(Ordering::Acquire) {
                continue;
            }
            let (part, rest) = bytes.split_at(length as usize);
            let Ok(mut view) = chunk.buffer.get_mapped_range_mut(chunk.used..chunk.used + length) else { return false };
            view.copy_from_slice(part);
            let follows = |copy: &&mut PendingCopy| {
                let ends = [copy.from.1 + copy.bytes, copy.to.1 + copy.bytes];
                ends == [chunk.used, to] && copy.from.0 == chunk.buffer && copy.to.0 == *target
            };
            match self.copies.last_mut().filter(follows) {
                Some(copy) => copy.bytes += length,
                None => {
                    let from = (chunk.buffer.clone(), chunk.used);
                    self.copies.push(PendingCopy { from, to: (target.clone(), to), bytes: length });
                }
            }
            chunk.used = (chunk.used + length).next_multiple_of(ALIGNMENT);
            to += length;
            bytes = rest;
        }
        bytes.is_empty()
    }

    /// Whether changes wait for the next submission.
    pub(super) fn has_changes(&self) -> bool {
        !self.copies.is_empty()
    }

    /// The commands that make the changes, if there are any. Submit them before the work that reads the buffers, then call
    /// [`Self::recall`].
    pub(super) fn take(&mut self, device: &wgpu::Device) -> Option<wgpu::CommandBuffer> {
        if self.copies.is_empty() {
            return None;
        }
        for chunk in self.chunks.iter().filter(|c| c.used > 0) {
            chunk.is_free.store(false, Ordering::Release);
            chunk.buffer.unmap();
        }
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for PendingCopy { from, to, bytes } in self.copies.drain(..) {
            encoder.copy_buffer_to_buffer(&from.0, from.1, &to.0, to.1, bytes);
        }
        Some(encoder.finish())
    }

    /// Maps the memory of the last [`Self::take`] again when the device has read it. A poll of the device ends that.
    pub(super) fn recall(&mut self) {
        for chunk in self.chunks.iter_mut().filter(|c| c.used > 0) {
            chunk.used = 0;
            let is_free = Arc::clone(&chunk.is_free);
            chunk.buffer.map_async(wgpu::MapMode::Write, .., move |mapped| {
                is_free.store(mapped.is_ok(), Ordering::Release);
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::created::created_on_this_thread;
    use crate::device::test_device;

    #[test]
    fn changes_arrive_in_their_order_and_make_no_memory() {
        let Some(gpu) = test_device() else { return };
        gpu.reserve_uploads(3 << 20);
        let size = 3 << 20;
        let buffer = gpu.storage("test", size);
        let before = created_on_this_thread();
        let mut expected = vec![0_u8; size as usize];
        for round in 1..20_u8 {
            // One that spans pieces, small ones over it, and one whose length is odd in pieces.
            let large = vec![round; 5 << 18];
            for (offset, bytes) in [(4, large.as_slice()), (8, &[round + 1; 12]), (1 << 20, &[round + 2; 28])] {
                gpu.write(&buffer, offset, bytes);
                expected[offset as usize..offset as usize + bytes.len()].copy_from_slice(bytes);
            }
            assert!(gpu.read(&buffer, size).unwrap() == expected, "round {round}");
        }
        assert_eq!(created_on_this_thread().uploads, before.uploads);
        // Without room wgpu makes its own, after what came before.
        gpu.write(&buffer, 0, &[1; 16]);
        gpu.write(&buffer, 0, &vec![2; size as usize]);
        gpu.write(&buffer, 0, &vec![3; size as usize]);
        gpu.write(&buffer, 4, &[4; 4]);
        let last = gpu.read(&buffer, size).unwrap();
        assert!(last[..4] == [3; 4] && last[4..8] == [4; 4] && last[8..].iter().all(|b| *b == 3));
        assert!(created_on_this_thread().uploads > before.uploads);
    }
}
