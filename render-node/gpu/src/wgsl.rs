//! Declarations in WGSL, written from the Rust types that hold the same bytes.
//!
//! [`shared_structs!`] declares structs for both sides. `encase` lays the Rust side out by WGSL's rules, so neither side counts
//! offsets or padding. [`shared_constants!`] declares numbers for both sides.

use encase::{ShaderSize, ShaderType};
use glam::{Mat3, UVec2, Vec2, Vec3, Vec4};

/// A type with a counterpart of the same layout in WGSL.
pub(super) trait WgslType: ShaderType {
    /// The counterpart's name.
    fn name() -> String;
}

macro_rules! counterparts {
    ($($rust:ty => $wgsl:literal,)+) => {
        $(impl WgslType for $rust {
            fn name() -> String {
                $wgsl.to_owned()
            }
        })+
    };
}

counterparts! {
    u32 => "u32",
    f32 => "f32",
    UVec2 => "vec2<u32>",
    Vec2 => "vec2<f32>",
    Vec3 => "vec3<f32>",
    Vec4 => "vec4<f32>",
    Mat3 => "mat3x3<f32>",
}

impl<T: WgslType + ShaderSize, const N: usize> WgslType for [T; N] {
    fn name() -> String {
        format!("array<{}, {N}>", T::name())
    }
}

/// A struct's declaration.
pub(super) fn struct_declaration(name: &str, members: &[(&str, String)]) -> String {
    let members: String = members.iter().map(|(member, kind)| format!("    {member}: {kind},\n")).collect();
    format!("struct {name} {{\n{members}}}\n")
}

/// A struct's layout as `encase` writes it, in bytes.
#[cfg(test)]
pub(super) struct StructLayout {
    pub(super) name: &'static str,
    pub(super) size: u64,
    /// Name and offset of each member.
    pub(super) members: Vec<(&'static str, u64)>,
}

/// Declares structs in Rust, and makes `struct_declarations()`, their text in WGSL.
macro_rules! shared_structs {
    ($(
        $(#[$about:meta])*
        $visible:vis struct $name:ident {
            $($(#[$about_member:meta])* $member:ident: $kind:ty,)+
        }
    )+) => {
        $(
            $(#[$about])*
            #[derive(Debug, Clone, Copy, Default, PartialEq, encase::ShaderType)]
            #[repr(C)]
            $visible struct $name {
                $($(#[$about_member])* pub(crate) $member: $kind,)+
            }

            impl $crate::wgsl::WgslType for $name {
                fn name() -> String {
                    stringify!($name).to_owned()
                }
            }
        )+

        fn struct_declarations() -> String {
            use $crate::wgsl::{WgslType, struct_declaration};
            [$(
                struct_declaration(stringify!($name), &[$((stringify!($member), <$kind as WgslType>::name())),+]),
            )+]
            .concat()
        }

        #[cfg(test)]
        fn struct_layouts() -> Vec<$crate::wgsl::StructLayout> {
            vec![$({
                let members = [$(stringify!($member)),+].into_iter().enumerate();
                $crate::wgsl::StructLayout {
                    name: stringify!($name),
                    size: <$name as encase::ShaderSize>::SHADER_SIZE.get(),
                    members: members
                        .map(|(k, member)| (member, <$name as encase::ShaderType>::METADATA.offset(k)))
                        .collect(),
                }
            }),+]
        }
    };
}

/// Declares numbers in Rust, and makes `constant_declarations()`, their text in WGSL.
macro_rules! shared_constants {
    ($($(#[$about:meta])* $name:ident: $kind:ident = $value:expr;)+) => {
        $($(#[$about])* pub(crate) const $name: $kind = $value;)+

        fn constant_declarations() -> String {
            [$(format!("const {}: {} = {:?};\n", stringify!($name), stringify!($kind), $name)),+].concat()
        }
    };
}

pub(super) use {shared_constants, shared_structs};
