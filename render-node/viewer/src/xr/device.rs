//! The graphics device that a runtime wants, opened for wgpu, and the runtime's images as wgpu's textures. The one file with
//! calls that the compiler cannot check: those between OpenXR, Vulkan and wgpu.
#![allow(
    unsafe_code,
    reason = "handles pass between three libraries, each of which trusts the caller for what they are"
)]

use std::ffi::CStr;
use std::mem;

use ash::vk::{self, Handle};
use openxr as xr;
use openxr::sys::CompositionLayerDepthInfoKHR as DepthInfo;
use openxr::sys::{
    CompositionLayerPassthroughFB as PassthroughLayer, SystemPassthroughPropertiesFB as PassthroughProperties,
};
use wgpu::hal::api::Vulkan;
use wgpu::hal::{self, vulkan};

use super::error::XrError;
use super::surroundings::Passthrough;
use sg_gpu::{Gpu, OPTIONAL_FEATURES};

/// wgpu takes functions of 1.3 for granted where the device has them, so the instance has to be of 1.3 as well.
const VERSION: u32 = vk::API_VERSION_1_3;

/// Queue family and place in it. Every device that runtimes offer has graphics, compute and transfer in the first.
const FAMILY: u32 = 0;

/// A session with its frame waiter and its frame stream.
pub(super) type SessionParts = (xr::Session<xr::Vulkan>, xr::FrameWaiter, xr::FrameStream<xr::Vulkan>);

/// The device, and the raw handles that a session is made with.
pub(super) struct VulkanDevice {
    pub(super) gpu: Gpu,
    /// Source of the device.
    pub(super) instance_and_adapter: (wgpu::Instance, wgpu::Adapter),
    instance: u64,
    physical: u64,
    device: u64,
}

/// The loader of OpenXR, looked for as the system's libraries are.
pub(super) fn loader() -> Result<xr::Entry, XrError> {
    // SAFETY: the loader is the system's. Loading a library runs its vendor's code, as for every library.
    unsafe { xr::Entry::load(&()) }.map_err(|e| XrError::NoLoader { reason: e.to_string() })
}

fn refused(what: &str, error: impl std::fmt::Display) -> XrError {
    XrError::Device { reason: format!("{what}: {error}") }
}

fn vulkan_result(
    what: &str,
    outcome: Result<Result<*const std::ffi::c_void, i32>, xr::sys::Result>,
) -> Result<u64, XrError> {
    outcome
        .map_err(|e| XrError::call("graphics device", e))?
        .map(|handle| handle as u64)
        .map_err(|code| refused(what, vk::Result::from_raw(code)))
}

impl VulkanDevice {
    /// Opens the device that the runtime wants for `system`.
    pub(super) fn open(instance: &xr::Instance, system: xr::SystemId) -> Result<Self, XrError> {
        // The runtime insists on being asked.
        let wanted = instance
            .graphics_requirements::<xr::Vulkan>(system)
            .map_err(|e| XrError::call("graphics requirements", e))?;
        let least = wanted.min_api_version_supported;
        if (least.major(), least.minor()) > (1, 3) {
            return Err(refused(
                "Vulkan",
                format!("the runtime asks for {}.{}, this is 1.3", least.major(), least.minor()),
            ));
        }
        // SAFETY: Vulkan's loader is the system's, as OpenXR's is.
        let entry = unsafe { ash::Entry::load() }.map_err(|e| refused("Vulkan", e))?;
        let flags = wgpu::InstanceFlags::empty().with_env();
        let extensions =
            vulkan::Instance::desired_extensions(&entry, VERSION, flags).map_err(|e| refused("Vulkan instance", e))?;
        let raw_instance = {
            let application = vk::ApplicationInfo::default().api_version(VERSION);
            let names: Vec<_> = extensions.iter().map(|e| e.as_ptr()).collect();
            let info = vk::InstanceCreateInfo::default().application_info(&application).enabled_extension_names(&names);
            // SAFETY: `info` and its pointers outlive the call. The two declarations of vkGetInstanceProcAddr differ only
            // in the names of their types.
            vulkan_result("Vulkan instance", unsafe {
                let find = mem::transmute::<vk::PFN_vkGetInstanceProcAddr, xr::sys::platform::VkGetInstanceProcAddr>(
                    entry.static_fn().get_instance_proc_addr,
                );
                instance.create_vulkan_instance(system, find, (&raw const info).cast())
            })?
        };
        // SAFETY: the handle is the instance just made, and `entry` is where it came from.
        let vulkan_instance = unsafe { ash::Instance::load(entry.static_fn(), vk::Instance::from_raw(raw_instance)) };
        // SAFETY: the instance was made by the runtime for this system.
        let physical = unsafe { instance.vulkan_graphics_device(system, raw_instance as _) }
            .map_err(|e| XrError::call("graphics device", e))? as u64;
        // SAFETY: the instance was made from `entry` with this version and just these extensions. From here on wgpu owns it
        // and destroys it after its last use.
        let hal_instance = unsafe {
            vulkan::Instance::from_raw(
                entry.clone(),
                vulkan_instance.clone(),
                VERSION,
                0,
                None,
                extensions,
                flags,
                wgpu::MemoryBudgetThresholds::default(),
                false,
                None,
            )
        }
        .map_err(|e| refused("Vulkan instance", e))?;
        let mut exposed = hal_instance
            .expose_adapter(vk::PhysicalDevice::from_raw(physical))
            .ok_or_else(|| refused("graphics device", "it lacks what drawing needs"))?;
        let info = exposed.info.clone();
        let features = exposed.features & OPTIONAL_FEATURES;
        let limits = exposed.capabilities.limits.clone();
        let extensions: Vec<&'static CStr> = exposed.adapter.required_device_extensions(features);
        let mut wanted = exposed.adapter.physical_device_features(&extensions, features);
        let raw_device = {
            let names: Vec<_> = extensions.iter().map(|e| e.as_ptr()).collect();
            let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(FAMILY).queue_priorities(&[1.0])];
            let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&names);
            let info = wanted.add_to_device_create(info);
            // SAFETY: as for the instance; the physical device is the one that the runtime gave for it.
            vulkan_result("Vulkan device", unsafe {
                let find = mem::transmute::<vk::PFN_vkGetInstanceProcAddr, xr::sys::platform::VkGetInstanceProcAddr>(
                    entry.static_fn().get_instance_proc_addr,
                );
                instance.create_vulkan_device(system, find, physical as _, (&raw const info).cast())
            })?
        };
        // SAFETY: the handle is the device just made from this instance.
        let vulkan_device = unsafe { ash::Device::load(vulkan_instance.fp_v1_0(), vk::Device::from_raw(raw_device)) };
        // SAFETY: the device was made from this adapter with this family, these extensions and features; wgpu owns it now.
        let open = unsafe {
            exposed.adapter.device_from_raw(
                vulkan_device,
                None,
                &extensions,
                features,
                &limits,
                &wgpu::MemoryHints::default(),
                FAMILY,
                0,
            )
        }
        .map_err(|e| refused("Vulkan device", e))?;
        // wgpu validates indirect calls for every instance made outside of it, at a dispatch and two barriers each, unless the
        // adapter lacks the storage buffers for that. Our passes write their arguments themselves. The device has its real
        // limits, those of its descriptor.
        exposed.capabilities.limits.max_storage_buffers_per_shader_stage = 1;
        // SAFETY: the three were made from one another, in this order, by wgpu's own layer.
        let (opened, instance_and_adapter) = unsafe {
            let instance = wgpu::Instance::from_hal::<Vulkan>(hal_instance);
            let adapter = instance.create_adapter_from_hal::<Vulkan>(exposed);
            let opened = adapter.create_device_from_hal::<Vulkan>(
                open,
                &wgpu::DeviceDescriptor {
                    label: Some("supergaussian, headset"),
                    required_features: features,
                    required_limits: limits,
                    ..wgpu::DeviceDescriptor::default()
                },
            );
            (opened, (instance, adapter))
        };
        let (device, queue) = opened.map_err(|e| refused("graphics device", e))?;
        let gpu = Gpu::of_device(device, queue, info);
        Ok(Self { gpu, instance_and_adapter, instance: raw_instance, physical, device: raw_device })
    }

    /// A session on this device.
    pub(super) fn session(&self, instance: &xr::Instance, system: xr::SystemId) -> Result<SessionParts, XrError> {
        let info = xr::vulkan::SessionCreateInfo {
            instance: self.instance as _,
            physical_device: self.physical as _,
            device: self.device as _,
            queue_family_index: FAMILY,
            queue_index: 0,
        };
        // The guard keeps the device until the session is destroyed, independent of the drop order of its parts.
        let guard = Box::new(self.gpu.clone());
        // SAFETY: the handles are those of `gpu`, made by this runtime for this system. The guard keeps them alive. The
        // queue is used on one thread, see `Headset`.
        unsafe { instance.create_session_with_guard::<xr::Vulkan>(system, &info, guard) }
            .map_err(|e| XrError::call("session", e))
    }
}

/// The images of a swapchain as textures that can be drawn to. They must be dropped before it.
pub(super) fn textures(
    gpu: &Gpu,
    swapchain: &xr::Swapchain<xr::Vulkan>,
    format: wgpu::TextureFormat,
    [width, height]: [u32; 2],
    layers: u32,
) -> Result<Vec<wgpu::Texture>, XrError> {
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: layers };
    let handed_over = match format.has_depth_aspect() {
        true => wgpu::TextureUses::DEPTH_STENCIL_WRITE,
        false => wgpu::TextureUses::COLOR_TARGET,
    };
    let images = swapchain.enumerate_images().map_err(|e| XrError::call("swapchain images", e))?;
    let wrapped = images.into_iter().map(|image| {
        let described = hal::TextureDescriptor {
            label: Some("headset image"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: handed_over,
            memory_flags: hal::MemoryFlags::empty(),
            view_formats: Vec::new(),
        };
        // SAFETY: the image is the runtime's, made with this size, format and use on this device. It is External and has a
        // callback, so wgpu destroys neither it nor its memory. The runtime hands images over as attachments.
        unsafe {
            let device =
                gpu.device().as_hal::<Vulkan>().ok_or_else(|| refused("graphics device", "it is not Vulkan's"))?;
            let texture = device.texture_from_raw(
                vk::Image::from_raw(image),
                &described,
                Some(Box::new(|| ())),
                vulkan::TextureMemory::External,
            );
            Ok(gpu.device().create_texture_from_hal::<Vulkan>(
                texture,
                &wgpu::TextureDescriptor {
                    label: described.label,
                    size,
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
                    view_formats: &[],
                },
                handed_over,
            ))
        }
    });
    wrapped.collect()
}

/// Depth information of a view: `depths` between a near and a far plane, in metres.
pub(super) fn depth_of(depths: xr::SwapchainSubImage<'_, xr::Vulkan>, [near_z, far_z]: [f32; 2]) -> DepthInfo {
    DepthInfo {
        ty: DepthInfo::TYPE,
        next: std::ptr::null(),
        sub_image: depths.into_raw(),
        min_depth: 0.0,
        max_depth: 1.0,
        near_z,
        far_z,
    }
}

/// Whether a headset has cameras for `XR_FB_passthrough`, an extension of this instance.
pub(super) fn supports_passthrough(instance: &xr::Instance, system: xr::SystemId) -> bool {
    let mut cameras = PassthroughProperties {
        ty: PassthroughProperties::TYPE,
        next: std::ptr::null(),
        supports_passthrough: xr::sys::FALSE,
    };
    let mut properties = xr::sys::SystemProperties::out((&raw mut cameras).cast());
    // SAFETY: both structs have their types and outlive the call, which follows the chain and writes to them.
    let outcome = unsafe { (instance.fp().get_system_properties)(instance.as_raw(), system, properties.as_mut_ptr()) };
    outcome == xr::sys::Result::SUCCESS && bool::from(cameras.supports_passthrough)
}

/// A layer of the surroundings as one of a frame's layers. `_owner` keeps the layer's handle.
pub(super) fn as_layer<'a>(
    layer: &'a PassthroughLayer,
    _owner: &'a Passthrough,
) -> &'a xr::CompositionLayerBase<'a, xr::Vulkan> {
    // SAFETY: a base is a transparent wrapper of the header that every layer of OpenXR begins with; the crate's own layers are
    // made into it in the same way. The layer's handle lives as long as its owner, and nothing is chained to the layer.
    unsafe { &*(&raw const *layer).cast() }
}

/// A submitted view with its depths; the depths must not move before submission.
pub(super) fn with_depth<'a>(
    view: xr::CompositionLayerProjectionView<'a, xr::Vulkan>,
    depth: &'a DepthInfo,
) -> xr::CompositionLayerProjectionView<'a, xr::Vulkan> {
    let mut raw = view.into_raw();
    raw.next = (&raw const *depth).cast();
    // SAFETY: the view was made by the safe builder and keeps its lifetime; the chained struct lives as long.
    unsafe { xr::CompositionLayerProjectionView::from_raw(raw) }
}
