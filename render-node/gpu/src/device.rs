//! Opens a graphics device, waits for it, and reports its errors.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use std::{fmt, io};

use encase::ShaderSize;
use encase::internal::WriteInto;

use crate::created::count_created;
use crate::device_class::DeviceClass;
use crate::error::GpuError;
use crate::pipeline_cache::{self, KeptPipelines};
use crate::uploads::Uploads;

/// Timeout of a wait. A software device compiles its shaders at their first use, for up to a minute on a busy
/// machine.
pub(super) const WAIT_TIMEOUT: Duration = Duration::from_secs(120);

/// Bytes of a uniform, or of rows of a table that are written together.
const ROOM: usize = 4096;

/// Interval between two polls of a waiting thread.
const POLL_INTERVAL: Duration = Duration::from_micros(200);

/// Optional features: they make pictures or starts faster, or time them.
pub const OPTIONAL_FEATURES: wgpu::Features = wgpu::Features::TIMESTAMP_QUERY
    .union(wgpu::Features::FLOAT32_BLENDABLE)
    .union(wgpu::Features::MULTIVIEW)
    .union(wgpu::Features::PIPELINE_CACHE);

/// An open device. Clones share it.
#[derive(Clone)]
pub struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    info: Arc<wgpu::AdapterInfo>,
    /// `None` for a device opened elsewhere.
    origin: Option<(wgpu::Instance, wgpu::Adapter)>,
    fault: Arc<Mutex<Option<GpuError>>>,
    lost: Arc<AtomicBool>,
    /// Locked during a submission, and while a surface waits for the end of all work.
    submission: Arc<Mutex<()>>,
    /// Pipelines kept on disk.
    pipelines: Arc<OnceLock<KeptPipelines>>,
    uploads: Arc<Mutex<Uploads>>,
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Gpu").field("name", &self.info.name).field("kind", &self.info.device_type).finish()
    }
}

/// Whether the system lists any device node of a graphics card. Loading every Vulkan driver takes a third of a
/// second, too long for a restarted view.
fn card_may_be_present() -> bool {
    let entries = std::fs::read_dir("/dev/dri").into_iter().flatten().flatten();
    let has_render_node = entries.into_iter().any(|e| e.file_name().to_string_lossy().starts_with("render"));
    // A confined process may use these devices, but not list their folder. NVIDIA's driver needs no node in /dev/dri, and WSL has none.
    let others = ["/dev/nvidiactl", "/dev/dxg"].map(|device| Path::new(device).exists());
    cfg!(not(target_os = "linux")) || has_render_node || others.contains(&true)
}

/// Keeps an error for the next [`Gpu::check`]. The first error is the cause. A lost device outranks its consequences.
fn keep(fault: &Mutex<Option<GpuError>>, error: GpuError) {
    let mut kept = fault.lock().unwrap_or_else(PoisonError::into_inner);
    if kept.is_none() || matches!(error, GpuError::Lost { .. }) {
        *kept = Some(error);
    }
}

impl Gpu {
    /// Description of an instance for [`Self::of_adapter`]: Vulkan, without wgpu's validation of indirect calls. That would add
    /// a dispatch and two barriers to each call. Our own passes write these arguments, within the limits of every device.
    #[must_use]
    pub fn instance_descriptor() -> wgpu::InstanceDescriptor {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        descriptor.flags = (descriptor.flags - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL).with_env();
        descriptor
    }

    /// Opens a device through Vulkan.
    ///
    /// # Errors
    /// [`GpuError::NoDevice`] without a device of this class, [`GpuError::Refused`] if the driver does not open it.
    pub fn open(class: DeviceClass) -> Result<Self, GpuError> {
        if class == DeviceClass::Hardware && !card_may_be_present() {
            return Err(GpuError::NoDevice { class });
        }
        let instance = wgpu::Instance::new(Self::instance_descriptor());
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
        let software = |a: &wgpu::Adapter| a.get_info().device_type == wgpu::DeviceType::Cpu;
        let adapter = adapters
            .into_iter()
            .filter(|a| match class {
                DeviceClass::Any => true,
                DeviceClass::Hardware => !software(a),
                DeviceClass::Software => software(a),
            })
            .min_by_key(|a| match a.get_info().device_type {
                wgpu::DeviceType::DiscreteGpu => 0,
                wgpu::DeviceType::VirtualGpu => 1,
                wgpu::DeviceType::IntegratedGpu => 2,
                wgpu::DeviceType::Other => 3,
                wgpu::DeviceType::Cpu => 4,
            })
            .ok_or(GpuError::NoDevice { class })?;
        Self::of_adapter(instance, adapter)
    }

    /// Opens the device of a chosen adapter, for example the one that can present to a window.
    ///
    /// # Errors
    /// [`GpuError::Refused`] if the driver does not open it.
    pub fn of_adapter(instance: wgpu::Instance, adapter: wgpu::Adapter) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("supergaussian"),
            required_features: adapter.features() & OPTIONAL_FEATURES,
            required_limits: adapter.limits(),
            ..wgpu::DeviceDescriptor::default()
        }))
        .map_err(|e| GpuError::Refused { device: info.name.clone(), reason: e.to_string() })?;
        Ok(Self { origin: Some((instance, adapter)), ..Self::of_device(device, queue, info) })
    }

    /// Wraps a device that another library opened, for example a headset's runtime. It needs all its limits and
    /// should have all supported [`OPTIONAL_FEATURES`]. It must have no handlers of lost devices or errors yet.
    #[must_use]
    pub fn of_device(device: wgpu::Device, queue: wgpu::Queue, info: wgpu::AdapterInfo) -> Self {
        let fault = Arc::new(Mutex::new(None));
        let lost = Arc::new(AtomicBool::new(false));
        let (lost_flag, faults, name) = (Arc::clone(&lost), Arc::clone(&fault), info.name.clone());
        device.set_device_lost_callback(move |_, reason| {
            keep(&faults, GpuError::Lost { device: name.clone(), reason });
            lost_flag.store(true, Ordering::Release);
        });
        let (broken, name) = (Arc::clone(&fault), info.name.clone());
        device.on_uncaptured_error(Arc::new(move |error| {
            let device = name.clone();
            let reason = error.to_string();
            keep(
                &broken,
                match error {
                    wgpu::Error::OutOfMemory { .. } => GpuError::Memory { device, reason },
                    _ => GpuError::Failed { device, reason },
                },
            );
        }));
        let gpu = Self {
            device,
            queue,
            info: Arc::new(info),
            origin: None,
            fault,
            lost,
            submission: Arc::default(),
            pipelines: Arc::default(),
            uploads: Arc::default(),
        };
        if let Some(folder) = pipeline_cache::folder() {
            gpu.keep_pipelines(folder);
        }
        gpu
    }

    /// Keeps the compiled pipelines of this device in a folder of the user's cache: loads the file of an earlier start, one for
    /// each kind of device. Returns whether there was a sound one; `None` if the driver keeps no pipelines. A damaged file is
    /// logged and ignored. Only the first call counts. [`Self::save_pipelines`] writes the file.
    pub fn keep_pipelines(&self, folder: &Path) -> Option<bool> {
        if self.pipelines.get().is_none()
            && let Some(kept) = KeptPipelines::load(&self.device, &self.info, folder)
        {
            let _ = self.pipelines.set(kept);
        }
        self.pipelines.get().map(|kept| kept.is_loaded)
    }

    /// Writes the compiled pipelines to their file, if there is one and pipelines were made since the last call. Returns whether
    /// it did. Takes milliseconds, so call it between frames.
    ///
    /// # Errors
    /// The file cannot be written; the next call tries again only after further pipelines.
    pub fn save_pipelines(&self) -> io::Result<bool> {
        self.pipelines.get().map_or(Ok(false), KeptPipelines::save)
    }

    /// As [`Self::save_pipelines`]; a failure is logged.
    pub(super) fn save_pipelines_or_log(&self) {
        if let Err(error) = self.save_pipelines() {
            tracing::warn!("compiled pipelines are not kept: {error}");
        }
    }

    /// The cache for a new pipeline.
    pub(super) fn cache_of_pipeline(&self) -> Option<&wgpu::PipelineCache> {
        count_created(|created| created.pipelines += 1);
        let kept = self.pipelines.get()?;
        kept.count();
        Some(&kept.cache)
    }

    /// Whether both are clones of one device.
    #[must_use]
    pub fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.fault, &other.fault)
    }

    /// Instance and adapter of the device, needed to present; `None` for [`Self::of_device`].
    #[must_use]
    pub fn origin(&self) -> Option<&(wgpu::Instance, wgpu::Adapter)> {
        self.origin.as_ref()
    }

    /// The wgpu device, for additional passes.
    #[must_use]
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// Submits work. The device runs submissions in order.
    pub fn submit(&self, commands: impl IntoIterator<Item = wgpu::CommandBuffer>) {
        let mut uploads = self.lock_uploads();
        let changes = uploads.take(&self.device);
        let is_changed = changes.is_some();
        {
            let _guard = self.lock_submission();
            self.queue.submit(changes.into_iter().chain(commands));
        }
        if is_changed {
            uploads.recall();
        }
    }

    /// Makes staging memory for so many bytes of changes that wait for the device.
    pub(super) fn reserve_uploads(&self, bytes: u64) {
        self.lock_uploads().reserve(&self.device, bytes);
    }

    /// Changes a buffer from byte `offset` on, before the next submission and after all earlier changes.
    pub(super) fn write(&self, buffer: &wgpu::Buffer, offset: u64, bytes: &[u8]) {
        let mut uploads = self.lock_uploads();
        if bytes.is_empty() || uploads.stage(buffer, offset, bytes) {
            return;
        }
        let others_wait = uploads.has_changes();
        drop(uploads);
        if others_wait {
            // wgpu makes its own changes before those of the same submission.
            self.submit([]);
        }
        count_created(|created| created.uploads += 1);
        self.queue.write_buffer(buffer, offset, bytes);
    }

    fn lock_uploads(&self) -> MutexGuard<'_, Uploads> {
        self.uploads.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls `then` when all work submitted so far is done. A poll of the device calls it.
    pub(super) fn when_done(&self, then: impl FnOnce() + Send + 'static) {
        let _guard = self.lock_submission();
        self.queue.on_submitted_work_done(then);
    }

    /// Configures a surface of this device's instance again, after the end of all work. The lock keeps other
    /// submissions away: wgpu would report them as an error.
    ///
    /// # Errors
    /// [`GpuError::Failed`] for an unsupported configuration, [`GpuError::Lost`] for a lost device. Do not draw to
    /// the surface after an error.
    pub fn configure(&self, surface: &wgpu::Surface<'_>, config: &wgpu::SurfaceConfiguration) -> Result<(), GpuError> {
        let guard = self.lock_submission();
        let refusals = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        surface.configure(&self.device, config);
        let refused = pollster::block_on(refusals.pop());
        drop(guard);
        // A poll reports a lost device.
        let _ = self.device.poll(wgpu::PollType::Poll);
        match refused {
            Some(error) => Err(self.failed(&error)),
            None if self.is_lost() => Err(self.lost_error()),
            None => Ok(()),
        }
    }

    fn lock_submission(&self) -> MutexGuard<'_, ()> {
        self.submission.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The wgpu queue, for uploads. Submit work with [`Self::submit`].
    #[must_use]
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Name of the device.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.info.name
    }

    /// Whether the device is a software device.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// Destroys the device as a driver's reset would. Every user of it gets [`GpuError::Lost`].
    pub fn lose(&self) {
        self.device.destroy();
    }

    /// Whether the device is lost.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.lost.load(Ordering::Acquire)
    }

    /// Returns the first error since the last call.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::Memory`], [`GpuError::Unbound`] or [`GpuError::Failed`], each once.
    pub fn check(&self) -> Result<(), GpuError> {
        match self.fault.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Reports an error at the next [`Self::check`].
    pub(super) fn report(&self, error: GpuError) {
        keep(&self.fault, error);
    }

    /// Waits for all submitted work, at most `WAIT_TIMEOUT`. It polls, because a wait inside the driver holds a
    /// wgpu lock that presentation on this device needs.
    pub fn wait(&self) -> Result<(), GpuError> {
        let done = Arc::new(AtomicBool::new(false));
        let signal = Arc::clone(&done);
        self.when_done(move || signal.store(true, Ordering::Release));
        let begun = Instant::now();
        loop {
            let polled = self.device.poll(wgpu::PollType::Poll);
            self.check()?;
            polled.map_err(|e| self.failed(&e))?;
            if done.load(Ordering::Acquire) {
                return Ok(());
            }
            if self.is_lost() {
                return Err(self.lost_error());
            }
            if begun.elapsed() > WAIT_TIMEOUT {
                return Err(self.failed(&format!("no answer within {} s", WAIT_TIMEOUT.as_secs())));
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    fn lost_error(&self) -> GpuError {
        let reason = "nothing that was handed in will be done".to_owned();
        GpuError::Lost { device: self.info.name.clone(), reason }
    }

    /// Limit of the bytes of a storage binding.
    pub(super) fn largest_binding(&self) -> u64 {
        let limits = self.device.limits();
        // The shaders count bytes and words in 32 bits.
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size).min(u64::from(u32::MAX - 255))
    }

    pub(super) fn has(&self, feature: wgpu::Features) -> bool {
        self.device.features().contains(feature)
    }

    /// A storage buffer. It has a minimum length, so that it can always be bound.
    pub(super) fn storage(&self, label: &str, bytes: u64) -> wgpu::Buffer {
        self.buffer(label, bytes, wgpu::BufferUsages::STORAGE)
    }

    pub(super) fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        count_created(|created| created.buffers += 1);
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.max(256).next_multiple_of(16),
            usage: usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
    }

    /// A uniform buffer that holds `value`.
    pub(super) fn uniform<T: ShaderSize + WriteInto>(&self, label: &str, value: &T) -> wgpu::Buffer {
        let buffer = self.buffer(label, T::SHADER_SIZE.get(), wgpu::BufferUsages::UNIFORM);
        self.write_uniform(&buffer, value);
        buffer
    }

    /// Writes the value of a uniform buffer.
    pub(super) fn write_uniform<T: ShaderSize + WriteInto>(&self, buffer: &wgpu::Buffer, value: &T) {
        let mut room = [0; ROOM];
        let Some(bytes) = room.get_mut(..T::SHADER_SIZE.get() as usize) else {
            self.report(self.failed(&"a uniform is too large"));
            return;
        };
        match encase::UniformBuffer::new(&mut *bytes).write(value) {
            Ok(()) => self.write(buffer, 0, bytes),
            Err(error) => self.report(self.failed(&error)),
        }
    }

    /// Writes the rows of a table to a storage buffer that is large enough, and allocates nothing. Returns their bytes.
    pub(super) fn write_table<T: ShaderSize + WriteInto>(
        &self,
        buffer: &wgpu::Buffer,
        rows: impl IntoIterator<Item = T>,
    ) -> u64 {
        let mut room = [0; ROOM];
        let row_bytes = T::SHADER_SIZE.get() as usize;
        let (mut offset, mut used) = (0, 0);
        for row in rows {
            if used + row_bytes > ROOM {
                self.write(buffer, offset, room.get(..used).unwrap_or_default());
                (offset, used) = (offset + used as u64, 0);
            }
            let written =
                room.get_mut(used..used + row_bytes).map(|bytes| encase::StorageBuffer::new(bytes).write(&row));
            match written {
                Some(Ok(())) => used += row_bytes,
                Some(Err(error)) => self.report(self.failed(&error)),
                None => self.report(self.failed(&"a row is too large")),
            }
        }
        self.write(buffer, offset, room.get(..used).unwrap_or_default());
        offset + used as u64
    }

    /// The bytes of a table in a storage buffer; none for an empty table.
    pub(super) fn table_bytes<T: ShaderSize + WriteInto>(&self, rows: &[T]) -> Vec<u8> {
        let mut bytes = encase::StorageBuffer::new(Vec::<u8>::new());
        if !rows.is_empty()
            && let Err(error) = bytes.write(rows)
        {
            self.report(self.failed(&error));
        }
        bytes.into_inner()
    }

    /// A storage buffer that holds a table.
    pub(super) fn table<T: ShaderSize + WriteInto>(&self, label: &str, rows: &[T]) -> wgpu::Buffer {
        let bytes = self.table_bytes(rows);
        let buffer = self.storage(label, bytes.len() as u64);
        self.queue.write_buffer(&buffer, 0, &bytes);
        buffer
    }

    fn failed(&self, reason: &dyn fmt::Display) -> GpuError {
        GpuError::Failed { device: self.info.name.clone(), reason: reason.to_string() }
    }

    /// A two-dimensional texture without mipmaps.
    pub fn texture(
        &self,
        label: &str,
        ([width, height], layers): ([u32; 2], u32),
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        count_created(|created| created.textures += 1);
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// Reads a buffer back. Waits for all submitted work.
    #[cfg(test)]
    pub(super) fn read(&self, source: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>, GpuError> {
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: bytes,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(source, 0, &staging, 0, bytes);
        self.submit([encoder.finish()]);
        self.mapped(&staging)
    }

    /// Reads a mappable buffer. Waits for all submitted work.
    pub(super) fn mapped(&self, staging: &wgpu::Buffer) -> Result<Vec<u8>, GpuError> {
        staging.map_async(wgpu::MapMode::Read, .., |_| ());
        self.wait()?;
        let bytes = staging.get_mapped_range(..).map_err(|e| self.failed(&e))?.to_vec();
        staging.unmap();
        Ok(bytes)
    }
}

/// A device for tests. Without one a test prints a message and returns, unless `SUPERGAUSSIAN_REQUIRE_GPU` is 1.
#[cfg(test)]
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
pub(crate) fn test_device() -> Option<Gpu> {
    match Gpu::open(DeviceClass::Any) {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            assert!(std::env::var_os("SUPERGAUSSIAN_REQUIRE_GPU").is_none_or(|v| v != "1"), "{error}");
            eprintln!("SKIPPED: {error}");
            None
        }
    }
}
