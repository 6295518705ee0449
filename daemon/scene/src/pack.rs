//! The scene as the GPU reads it: plain bytes in fixed layouts.
//!
//! Each struct here has a twin of the same name in `shaders-glsl/include/scene.glsl`; a test reflects the SPIR-V and
//! compares every offset. Positions are metres in the world frame, relative to [`Scene::origin_m`](crate::Scene).

use bytemuck::{Pod, Zeroable};

/// No texture.
pub const NO_TEXTURE: u32 = u32::MAX;

/// [`GpuInstance::flags`]: a white physical thing.
pub const ROLE_PROP: u32 = 1;
/// [`GpuInstance::flags`]: nothing is there physically.
pub const ROLE_VIRTUAL: u32 = 2;
/// [`GpuInstance::flags`]: owned by the rasteriser; never in the top level.
pub const ROLE_RASTER: u32 = 4;
/// [`GpuInstance::flags`]: physical, must stay dark.
pub const ROLE_MASK: u32 = 8;
/// [`GpuInstance::flags`]: no triangle of it lets light through, so a shadow ray may end at its first hit.
pub const INSTANCE_OPAQUE: u32 = 256;

/// One placed mesh; 128 bytes, read as eight `uvec4` of a texel buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuInstance {
    /// Three rows of the affine matrix, world (relative to the origin) from object, m.
    pub world_from_object: [[f32; 4]; 3],
    /// Three rows of its inverse.
    pub object_from_world: [[f32; 4]; 3],
    /// First CWBVH node of its mesh, in nodes of 80 bytes. Where a mesh lies is the renderer's to say: 0 in a scene.
    pub node_base: u32,
    /// First triangle of its mesh; 0 in a scene.
    pub triangle_base: u32,
    /// First vertex of its mesh; 0 in a scene.
    pub vertex_base: u32,
    /// Index of its node in `scene.get` order.
    pub scene_node: u32,
    /// A role bit, and [`INSTANCE_OPAQUE`].
    pub flags: u32,
    /// Added to a triangle's material number.
    pub material_base: u32,
    /// Triangles of its mesh.
    pub triangle_count: u32,
    /// Zero.
    pub pad: u32,
}

/// A glTF metallic-roughness material; 112 bytes, read as seven `uvec4` of a texel buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuMaterial {
    /// Linear RGB and alpha.
    pub base_color: [f32; 4],
    /// Linear RGB, strength included.
    pub emissive: [f32; 3],
    /// 0 to 1.
    pub metallic: f32,
    /// Absorption inside the body, per metre and channel: −ln(attenuation colour) / attenuation distance.
    pub absorption_per_m: [f32; 3],
    /// Perceptual, 0 to 1.
    pub roughness: f32,
    /// 0 to 1.
    pub transmission: f32,
    /// Above 0: a closed body that refracts; 0: a thin sheet.
    pub thickness: f32,
    /// Index of refraction.
    pub ior: f32,
    /// 0 to 1.
    pub clearcoat: f32,
    /// Perceptual, 0 to 1.
    pub clearcoat_roughness: f32,
    /// Scale of the normal texture.
    pub normal_scale: f32,
    /// KHR_materials_specular's factor, 0 to 1.
    pub specular: f32,
    /// Index into the textures, or [`NO_TEXTURE`].
    pub base_color_texture: u32,
    /// Index into the textures, or [`NO_TEXTURE`].
    pub metallic_roughness_texture: u32,
    /// Index into the textures, or [`NO_TEXTURE`].
    pub emissive_texture: u32,
    /// Index into the textures, or [`NO_TEXTURE`].
    pub normal_texture: u32,
    /// Zero.
    pub pad0: u32,
    /// Zero; rounds the size up to a multiple of 16 bytes.
    pub pad1: [u32; 4],
}

/// Where a texture's texels lie, and how they wrap; 16 bytes, std430.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuTexture {
    /// First texel of its image. Where an image lies is the renderer's to say: 0 in a scene.
    pub first_texel: u32,
    /// Texels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bits 0–1 wrap s, bits 2–3 wrap t (0 repeat, 1 mirrored repeat, 2 clamp); bit 4 sRGB; bit 5 nearest.
    pub flags: u32,
}

/// [`GpuLight::kind`].
pub const LIGHT_DIRECTIONAL: u32 = 0;
/// [`GpuLight::kind`].
pub const LIGHT_POINT: u32 = 1;
/// [`GpuLight::kind`].
pub const LIGHT_SPOT: u32 = 2;

/// A punctual light, as KHR_lights_punctual has it; 64 bytes, read as four `uvec4` of a texel buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuLight {
    /// Metres, relative to the origin; unused by a directional light.
    pub position: [f32; 3],
    /// One of the `LIGHT_` constants.
    pub kind: u32,
    /// The way the light travels, unit length.
    pub direction: [f32; 3],
    /// Metres; 0 = infinite.
    pub range: f32,
    /// Linear RGB × intensity: lux (directional) or candela.
    pub intensity: [f32; 3],
    /// Cosine of the outer cone angle.
    pub cos_outer: f32,
    /// Cosine of the inner cone angle.
    pub cos_inner: f32,
    /// Zero.
    pub pad: [f32; 3],
}

/// The top level: instances, and the structure over those that rays can meet.
#[derive(Clone, Debug, Default)]
pub struct GpuTop {
    /// Every instance, drawn or not, in `scene.get` order of nodes and glTF order inside a node.
    pub instances: Vec<GpuInstance>,
    /// CWBVH nodes over the visible instances whose role is not raster; empty when there are none.
    pub nodes: Vec<[u32; 4]>,
    /// A leaf's primitive number → index into `instances`.
    pub order: Vec<u32>,
}

/// What a miss sees.
#[derive(Clone, Debug)]
pub struct GpuEnvironment {
    /// Texels a row of level 0.
    pub width: u32,
    /// Rows of level 0.
    pub height: u32,
    /// Linear RGB (w = 0), level 0 first, row 0 on top; each next level halves both sides (at least 1) by a 2 × 2 box,
    /// down to 1 × 1.
    pub texels: Vec<[f32; 4]>,
    /// Irradiance over π (what a white diffuse surface shows) as nine spherical-harmonic coefficients of order 2,
    /// cosine lobe already convolved: Ramamoorthi and Hanrahan, SIGGRAPH 2001. Basis order 1; y, z, x; xy, yz,
    /// 3z²−1, xz, x²−y², constants folded in, so that the shader sums coefficient × polynomial.
    pub irradiance: [[f32; 4]; 9],
}
