//! A stable radix sort of keys with their values by reduce and scan.

use crate::device::Gpu;
use crate::pipeline::{BoundKernel, Kernel};
use crate::resources::Resources;
use crate::shader::{Shader, running_sums};
use crate::shader_layout::{SORT_BITS, SORT_BLOCK, SortPass};

/// The three kernels of a sort. The number of keys is a member of [`crate::shader_layout::Totals`].
pub(super) struct RadixSort {
    count: Kernel,
    scan: Kernel,
    scatter: Kernel,
    /// The uniform of each pass.
    sort_passes: Vec<wgpu::Buffer>,
}

/// The passes of a sort, bound to the two buffer sets of [`SortBuffers`] in turn.
pub(super) struct SortBindings {
    passes: Vec<[BoundKernel; 3]>,
}

/// Two sets of keys and values.
pub(super) struct SortBuffers {
    pub(super) keys: [wgpu::Buffer; 2],
    pub(super) values: [wgpu::Buffer; 2],
    digit_counts: wgpu::Buffer,
}

impl SortBuffers {
    /// Buffers for `capacity` keys.
    pub(super) fn new(gpu: &Gpu, label: &str, capacity: u64) -> Self {
        let words = || gpu.storage(label, 4 * capacity);
        Self {
            keys: [words(), words()],
            values: [words(), words()],
            digit_counts: gpu.storage(label, 4 * (1 << SORT_BITS) * capacity.div_ceil(SORT_BLOCK.into())),
        }
    }
}

/// Text of the kernels for as many keys as the member `count` of the totals says.
pub(super) fn source(count: &str) -> String {
    let key_count = format!("fn key_count() -> u32 {{ return totals.{count}; }}\n");
    [&key_count, &running_sums("digit_counts"), include_str!("shaders/sort.wgsl")].concat()
}

impl RadixSort {
    /// A sort of as many keys as the member `count` of the totals says.
    pub(super) fn new(gpu: &Gpu, count: &str) -> Self {
        let shader = Shader::new(gpu, "sort", &[&source(count)]);
        let kernel = |entry| Kernel::new(gpu, &shader, entry, &[]);
        let passes = (0..u32::BITS).step_by(SORT_BITS as usize);
        Self {
            count: kernel("count"),
            scan: kernel("scan"),
            scatter: kernel("scatter"),
            sort_passes: passes.map(|shift| gpu.uniform("sort pass", &SortPass { shift })).collect(),
        }
    }

    /// Binds the passes over the lowest `bits` bits.
    pub(super) fn bind(&self, gpu: &Gpu, totals: &wgpu::Buffer, buffers: &SortBuffers, bits: u32) -> SortBindings {
        let SortBuffers { keys, values, digit_counts } = buffers;
        let passes = self.sort_passes.iter().take(bits.div_ceil(SORT_BITS) as usize).enumerate();
        let passes = passes.map(|(k, sort_pass)| {
            let (from, to) = (k % 2, 1 - k % 2);
            let resources = Resources::of([
                ("sort_pass", sort_pass),
                ("totals", totals),
                ("digit_counts", digit_counts),
                ("keys", &keys[from]),
                ("values", &values[from]),
                ("sorted_keys", &keys[to]),
                ("sorted_values", &values[to]),
            ]);
            [&self.count, &self.scan, &self.scatter].map(|kernel| kernel.bind(gpu, &resources))
        });
        SortBindings { passes: passes.collect() }
    }
}

impl SortBindings {
    /// Sorts. The number of blocks is at byte `offset` of `arguments`.
    pub(super) fn run(&self, pass: &mut wgpu::ComputePass<'_>, arguments: &wgpu::Buffer, offset: usize) {
        self.run_lowest(pass, arguments, offset, u32::BITS);
    }

    /// Sorts by the lowest `bits` bits at most. With an even number of passes less, the result is in the same set of buffers.
    pub(super) fn run_lowest(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        arguments: &wgpu::Buffer,
        offset: usize,
        bits: u32,
    ) {
        for [count, scan, scatter] in self.passes.iter().take(bits.div_ceil(SORT_BITS) as usize) {
            count.run_indirect(pass, arguments, offset);
            scan.run(pass, [1, 1, 1]);
            scatter.run_indirect(pass, arguments, offset);
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
    use crate::shader_layout::{DispatchArguments, Totals};

    /// Sorts on the device; positions are the values.
    fn sorted(gpu: &Gpu, keys: &[u32], bits: u32) -> (Vec<u32>, Vec<u32>) {
        let n = keys.len() as u32;
        let sort = RadixSort::new(gpu, "marked");
        let buffers = SortBuffers::new(gpu, "test", u64::from(n));
        let totals = gpu.table("totals", &[Totals { marked: n, ..Totals::default() }]);
        let dispatches = gpu.buffer("dispatches", 16, wgpu::BufferUsages::INDIRECT);
        let arguments = DispatchArguments { x: n.div_ceil(SORT_BLOCK), y: 1, z: 1 };
        let values: Vec<u32> = (0..n).collect();
        gpu.queue.write_buffer(&dispatches, 0, &gpu.table_bytes(&[arguments]));
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
