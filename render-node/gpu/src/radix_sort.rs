//! A stable radix sort of keys with their values by reduce and scan.

use crate::device::Gpu;
use crate::pipeline::{BoundKernel, Kernel, shader_module};
use crate::shader_layout::Total;

/// Bits of one pass.
const BITS: u32 = 4;

/// Number of keys of one workgroup.
const BLOCK: u64 = 4096;

/// The three kernels of a sort. The number of keys is one word of the totals.
pub(super) struct RadixSort {
    count: Kernel,
    scan: Kernel,
    scatter: Kernel,
    shifts: Vec<wgpu::Buffer>,
}

/// The passes of a sort, bound to the two buffer sets of [`SortBuffers`] in turn.
pub(super) struct SortBindings {
    passes: Vec<[BoundKernel; 3]>,
}

/// Two sets of keys and values.
pub(super) struct SortBuffers {
    pub(super) keys: [wgpu::Buffer; 2],
    pub(super) values: [wgpu::Buffer; 2],
    counts: wgpu::Buffer,
}

impl SortBuffers {
    /// Buffers for `capacity` keys.
    pub(super) fn new(gpu: &Gpu, label: &str, capacity: u64) -> Self {
        let words = || gpu.storage(label, 4 * capacity);
        Self {
            keys: [words(), words()],
            values: [words(), words()],
            counts: gpu.storage(label, 4 * (1 << BITS) * capacity.div_ceil(BLOCK)),
        }
    }
}

impl RadixSort {
    /// A sort of as many keys as the word `count` of the totals says.
    pub(super) fn new(gpu: &Gpu, count: Total) -> Self {
        let module = shader_module(gpu, "sort", include_str!("shaders/sort.wgsl"));
        let constants = [("COUNT", f64::from(count as u32))];
        let shifts = (0..u32::BITS / BITS)
            .map(|pass| {
                let buffer = gpu.buffer("shift", 16, wgpu::BufferUsages::UNIFORM);
                gpu.queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&[BITS * pass, 0, 0, 0]));
                buffer
            })
            .collect();
        Self {
            count: Kernel::new(gpu, &module, "count", &constants),
            scan: Kernel::new(gpu, &module, "scan", &constants),
            scatter: Kernel::new(gpu, &module, "scatter", &constants),
            shifts,
        }
    }

    /// Binds the passes over the lowest `bits` bits.
    pub(super) fn bind(&self, gpu: &Gpu, totals: &wgpu::Buffer, buffers: &SortBuffers, bits: u32) -> SortBindings {
        let SortBuffers { keys, values, counts } = buffers;
        let passes = self.shifts.iter().take(bits.div_ceil(BITS) as usize).enumerate().map(|(pass, shift)| {
            let (from, to) = (pass % 2, 1 - pass % 2);
            [
                self.count.bind(gpu, &[(0, shift), (1, totals), (2, &keys[from]), (6, counts)]),
                self.scan.bind(gpu, &[(1, totals), (6, counts)]),
                self.scatter.bind(
                    gpu,
                    &[
                        (0, shift),
                        (1, totals),
                        (2, &keys[from]),
                        (3, &values[from]),
                        (4, &keys[to]),
                        (5, &values[to]),
                        (6, counts),
                    ],
                ),
            ]
        });
        SortBindings { passes: passes.collect() }
    }
}

impl SortBindings {
    /// Sorts. `dispatches` holds the number of blocks from word `at` on.
    pub(super) fn run(&self, pass: &mut wgpu::ComputePass<'_>, dispatches: &wgpu::Buffer, at: u64) {
        for [count, scan, scatter] in &self.passes {
            count.run_indirect(pass, dispatches, at);
            scan.run(pass, [1, 1, 1]);
            scatter.run_indirect(pass, dispatches, at);
        }
    }

    /// Index of the buffer set that holds the result.
    pub(super) fn result(&self) -> usize {
        self.passes.len() % 2
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::device::test_device;

    /// Sorts on the device; positions are the values.
    fn sorted(gpu: &Gpu, keys: &[u32], bits: u32) -> (Vec<u32>, Vec<u32>) {
        let n = keys.len() as u32;
        let sort = RadixSort::new(gpu, Total::Marked);
        let buffers = SortBuffers::new(gpu, "test", u64::from(n));
        let totals = gpu.storage("totals", 16);
        let dispatches = gpu.buffer("dispatches", 16, wgpu::BufferUsages::INDIRECT);
        let values: Vec<u32> = (0..n).collect();
        gpu.queue.write_buffer(&totals, 0, bytemuck::bytes_of(&[0, n, 0, 0]));
        gpu.queue.write_buffer(&dispatches, 0, bytemuck::bytes_of(&[n.div_ceil(4096), 1, 1, 0]));
        gpu.queue.write_buffer(&buffers.keys[0], 0, bytemuck::cast_slice(keys));
        gpu.queue.write_buffer(&buffers.values[0], 0, bytemuck::cast_slice(&values));
        let sorting = sort.bind(gpu, &totals, &buffers, bits);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            sorting.run(&mut pass, &dispatches, 0);
        }
        gpu.submit([encoder.finish()]);
        let read = |buffer: &wgpu::Buffer| {
            bytemuck::pod_collect_to_vec::<u8, u32>(&gpu.read(buffer, 4 * u64::from(n)).unwrap())
        };
        (read(&buffers.keys[sorting.result()]), read(&buffers.values[sorting.result()]))
    }

    #[test]
    fn the_order_is_a_permutation_and_stable() {
        let Some(gpu) = test_device() else { return };
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for (n, bits, top) in [
            (1_u32, 32, u32::MAX),
            (4095, 32, 9),
            (4097, 32, u32::MAX),
            (200_003, 32, u32::MAX),
            (150_000, 12, 4095),
            (70_000, 16, 65_535),
        ] {
            let keys: Vec<u32> = (0..n).map(|_| rng.random_range(0..=top)).collect();
            let (got, order) = sorted(&gpu, &keys, bits);
            let mut want: Vec<u32> = (0..n).collect();
            want.sort_by_key(|i| keys[*i as usize]);
            assert_eq!(order, want, "{n} keys of {bits} bits");
            assert!(got.iter().zip(&want).all(|(key, i)| *key == keys[*i as usize]));
        }
    }
}
