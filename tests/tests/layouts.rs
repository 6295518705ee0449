//! What Rust and GLSL both name is the same to both: every offset, size and stride out of the SPIR-V, every field that is read
//! out of texels, and every constant.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    collections::{BTreeMap, HashMap},
    fs,
    mem::offset_of,
    path::Path,
    time::Duration,
};

use lantern_calibration::{GpuFrustum, GpuLens, LENS_BROWN_CONRADY, LENS_NONE, LENS_STEPS, LENS_WARP};
use lantern_gpu::{
    Binding, BindingKind, Bindings, Buffer, BufferKind, ComputePipeline, Recorder, Resource, TexelFormat,
};
use lantern_render::moved::{GpuMovedBox, GpuShown, MAX_BOXES};
use lantern_render::tile_lists::{EDGE_TILES, TILE_BOUNDS_BYTES, TILE_LISTS, TILE_PX, TileList};
use lantern_render::{GpuFrame, GpuSetup, MAX_VIEWERS, Pattern, RayCounts, RayKind, RecordHead, RecordedRay, shaders};
use lantern_scene::{
    PRIMARY_ROLES, SECONDARY_ROLES,
    pack::{
        GpuInstance, GpuLight, GpuMaterial, GpuTexture, INSTANCE_OPAQUE, LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_SPOT,
        NO_TEXTURE, ROLE_MASK, ROLE_PROP, ROLE_RASTER, ROLE_VIRTUAL,
    },
};
use lantern_tests::gpu::{assert_validation_is_silent, device, shader};
use rspirv::{
    dr::{Instruction, Module, Operand},
    spirv::{Decoration, Op, Word},
};

/// A struct's members by name: offset and size, bytes.
type Members = BTreeMap<String, (u32, u32)>;

/// The twins' members, padding left out: what lies there is nobody's.
fn without_padding(members: Members) -> Members {
    members.into_iter().filter(|(name, _)| !name.starts_with("pad")).collect()
}

fn size_of_field<T, F>(_: impl Fn(&T) -> &F) -> u32 {
    size_of::<F>() as u32
}

/// The members of a Rust struct, all of them: one that is forgotten does not compile.
macro_rules! members {
    ($ty:ident { $($field:ident),* $(,)? }) => {{
        let _all = |value: &$ty| { let $ty { $($field: _),* } = value; };
        let pairs = [$((
            stringify!($field).to_owned(),
            (offset_of!($ty, $field) as u32, size_of_field(|value: &$ty| &value.$field)),
        )),*];
        (without_padding(Members::from(pairs)), size_of::<$ty>() as u32)
    }};
}

/// One shader's types.
struct Reflection {
    module: Module,
    types: HashMap<Word, Instruction>,
    names: HashMap<Word, String>,
}

fn id(operand: &Operand) -> Word {
    match operand {
        Operand::IdRef(id) => *id,
        other => panic!("an id is expected, and there is {other:?}"),
    }
}

fn number(operand: &Operand) -> u32 {
    match operand {
        Operand::LiteralBit32(value) => *value,
        other => panic!("a number is expected, and there is {other:?}"),
    }
}

impl Reflection {
    fn new(words: &[u32]) -> Self {
        let module = rspirv::dr::load_words(words).unwrap();
        let types = module.types_global_values.iter().filter_map(|i| Some((i.result_id?, i.clone()))).collect();
        let named = |i: &Instruction| match i.operands.as_slice() {
            [Operand::IdRef(id), Operand::LiteralString(name)] => Some((*id, name.clone())),
            _ => None,
        };
        let names = module.debug_names.iter().filter(|i| i.class.opcode == Op::Name).filter_map(named).collect();
        Self { module, types, names }
    }

    fn decoration(&self, of: Word, wanted: Decoration) -> Option<u32> {
        self.module.annotations.iter().find_map(|i| match i.operands.as_slice() {
            [Operand::IdRef(target), Operand::Decoration(decoration), value]
                if *target == of && *decoration == wanted =>
            {
                Some(number(value))
            }
            _ => None,
        })
    }

    fn offset(&self, of: Word, member: u32) -> Option<u32> {
        self.module.annotations.iter().find_map(|i| match i.operands.as_slice() {
            [
                Operand::IdRef(target),
                Operand::LiteralBit32(m),
                Operand::Decoration(Decoration::Offset),
                Operand::LiteralBit32(offset),
            ] if *target == of && *m == member => Some(*offset),
            _ => None,
        })
    }

    /// Bytes of a type as it lies in memory, without the padding behind it.
    fn size(&self, ty: Word) -> u32 {
        let declared = &self.types[&ty];
        let operands = &declared.operands;
        match declared.class.opcode {
            Op::TypeInt | Op::TypeFloat => number(&operands[0]) / 8,
            Op::TypeVector => self.size(id(&operands[0])) * number(&operands[1]),
            Op::TypeArray => {
                let length = number(&self.types[&id(&operands[1])].operands[0]);
                self.decoration(ty, Decoration::ArrayStride).unwrap() * length
            }
            Op::TypeStruct => {
                let last = operands.len() as u32 - 1;
                self.offset(ty, last).unwrap() + self.size(id(&operands[last as usize]))
            }
            other => panic!("{other:?} is of no size that is handled"),
        }
    }

    fn member_names(&self, of: Word) -> Vec<String> {
        let mut names = BTreeMap::new();
        for i in self.module.debug_names.iter().filter(|i| i.class.opcode == Op::MemberName) {
            if let [Operand::IdRef(target), Operand::LiteralBit32(member), Operand::LiteralString(name)] =
                &i.operands[..]
                && *target == of
            {
                names.insert(*member, name.clone());
            }
        }
        names.into_values().collect()
    }

    /// Types of this name.
    fn structs(&self, name: &str) -> impl Iterator<Item = Word> {
        self.types
            .iter()
            .filter(move |(id, i)| i.class.opcode == Op::TypeStruct && self.names.get(*id).is_some_and(|n| n == name))
            .map(|(id, _)| *id)
    }

    /// Those that lie in memory, which alone have offsets.
    fn members(&self, name: &str) -> Vec<Members> {
        let laid_out = self.structs(name).filter(|ty| self.offset(*ty, 0).is_some());
        laid_out
            .map(|ty| {
                let types = self.types[&ty].operands.iter().map(id);
                let all = self.member_names(ty).into_iter().zip(types).enumerate();
                // An array without an end is no part of what stands before it.
                let ends = |of: &Word| self.types[of].class.opcode != Op::TypeRuntimeArray;
                all.filter(|(_, (_, of))| ends(of))
                    .map(|(m, (name, of))| (name, (self.offset(ty, m as u32).unwrap(), self.size(of))))
                    .collect()
            })
            .map(without_padding)
            .collect()
    }

    /// The stride of a block that is one array without an end.
    fn stride(&self, block: &str) -> Vec<u32> {
        let of = |ty: Word| match self.types[&ty].operands.as_slice() {
            [only] => self.decoration(id(only), Decoration::ArrayStride),
            _ => None,
        };
        self.structs(block).filter_map(of).collect()
    }
}

fn reflections() -> Vec<(&'static str, Reflection)> {
    shaders::ALL.iter().map(|shader| (shader.name, Reflection::new(shader.spirv))).collect()
}

/// The twins: GLSL's name, and Rust's members and size.
fn twins() -> Vec<(&'static str, (Members, u32))> {
    let frustum = members!(GpuFrustum {
        near_00,
        near_dx,
        near_dy,
        far_00,
        far_dx,
        far_dy,
        clip_x,
        clip_y,
        clip_w,
        depth_row,
        resolution_px,
        z_base,
        y_sign,
    });
    let frame = members!(GpuFrame { frustum, irradiance, viewers });
    let setup = members!(GpuSetup {
        environment_px,
        viewer_count,
        light_count,
        samples,
        strata,
        max_depth,
        tlas_node_count,
        virtual_count,
        projector_count,
        projector_index,
        blend,
        planes_a_group,
        shade_once,
        pattern,
        environment_first,
    });
    let lens = members!(GpuLens {
        focal_px,
        centre_px,
        k1_k2_p1_p2,
        k3,
        reach,
        kind,
        has_alpha,
        nodes,
        inverse_nodes,
        nodes_a_px,
        inverse_low_px,
        inverse_step_px,
        first_texel,
        inverse_first_texel,
        pad0,
    });
    let shown = members!(GpuShown { tiles, edged_px });
    let texture = members!(GpuTexture { first_texel, width, height, flags });
    let moved = members!(GpuMovedBox { low, pad0, high, pad1 });
    let (counts, counts_size) = members!(RayCounts { primary, secondary, shadow, blend, most_steps });
    let suffixed = |name: String| if name == "most_steps" { name } else { format!("{name}_rays") };
    let counts = counts.into_iter().map(|(name, place)| (suffixed(name), place)).collect();
    let head = members!(RecordHead { wanted_kind, wanted_part, part_count, record_room, records_kept, rays_traced });
    let ray =
        members!(RecordedRay { origin, t_min, direction, t_max, t, instance, triangle, pixel, sample_index, turn });
    vec![
        ("GpuFrustum", frustum),
        ("Frame", frame),
        ("GpuSetup", setup),
        ("GpuLens", lens),
        ("GpuShown", shown),
        ("GpuTexture", texture),
        ("GpuMovedBox", moved),
        ("Counters", (counts, counts_size)),
        ("Records", head),
        ("RecordedRay", ray),
    ]
}

#[test]
fn every_member_lies_where_its_twin_does() {
    let reflections = reflections();
    for (name, (expected, size)) in twins() {
        let mut found = 0;
        for (shader, reflection) in &reflections {
            for members in reflection.members(name) {
                assert_eq!(members, expected, "{name} in {shader}");
                found += 1;
            }
        }
        println!("{name}: {} members, {size} bytes, the same in {found} places", expected.len());
        assert!(found > 0, "{name} is in no shader");
    }

    // What compares as equal must be able to differ.
    let twins = twins();
    let (_, (frustum, _)) = &twins[0];
    assert!(reflections.iter().flat_map(|(_, r)| r.members("Frame")).all(|members| members != *frustum));
}

#[test]
fn every_array_has_its_twins_stride() {
    let twins: HashMap<_, _> = twins().into_iter().map(|(name, (_, size))| (name, size)).collect();
    for (block, element) in [("Projectors", "GpuFrustum"), ("Lenses", "GpuLens"), ("Textures", "GpuTexture")] {
        let strides: Vec<u32> = reflections().iter().flat_map(|(_, reflection)| reflection.stride(block)).collect();
        assert!(!strides.is_empty(), "{block} is in no shader");
        assert!(strides.iter().all(|stride| *stride == twins[element]), "{block}: {strides:?}, {}", twins[element]);
    }
    let strides: Vec<u32> = reflections().iter().flat_map(|(_, reflection)| reflection.stride("TileBounds")).collect();
    assert_eq!(strides, [TILE_BOUNDS_BYTES as u32]);
    // A uniform block's size is rounded up to its widest alignment, and Rust's struct with it.
    assert_eq!(twins["Frame"] % 16, 0);
}

/// The words of a second element whose every field is another, behind a first of zeros.
macro_rules! second {
    ($ty:ident) => {{
        let words = size_of::<$ty>() / 4;
        let mut all = vec![0f32; words];
        all.extend((0..words).map(|word| 1.0 + word as f32));
        let second: $ty = bytemuck::cast_slice(&all)[1];
        (all, second)
    }};
}

/// The bits of fields, in order.
macro_rules! bits {
    ($value:ident: $($field:ident),* $(,)?) => {{
        let mut all: Vec<u32> = Vec::new();
        $(all.extend_from_slice(bytemuck::cast_slice(bytemuck::bytes_of(&$value.$field)));)*
        all
    }};
}

/// Materials, lights and instances are read by the shaders as words of texels. Here the shaders' own functions read them, and
/// every field must be what Rust has under that name.
#[test]
fn every_field_out_of_texels_is_its_twins() {
    const fn row(binding: u32, name: &'static str, kind: BindingKind) -> Binding {
        let writes = matches!(kind, BindingKind::StorageBuffer);
        Binding { set: 0, binding, name, kind, reads: !writes, writes }
    }
    const TABLE: &[Binding] = &[
        row(4, "instances", BindingKind::UniformTexelBuffer),
        row(7, "materials", BindingKind::UniformTexelBuffer),
        row(8, "lights", BindingKind::UniformTexelBuffer),
        row(30, "Fields", BindingKind::StorageBuffer),
    ];
    let (materials, m) = second!(GpuMaterial);
    let (lights, l) = second!(GpuLight);
    let (instances, i) = second!(GpuInstance);
    let expected = [
        bits!(m: base_color, emissive, metallic, absorption_per_m, roughness, transmission, thickness, ior, clearcoat,
            clearcoat_roughness, normal_scale, specular, base_color_texture, metallic_roughness_texture, emissive_texture,
            normal_texture),
        bits!(l: position, kind, direction, range, intensity, cos_outer, cos_inner),
        bits!(i: world_from_object, object_from_world, node_base, triangle_base, vertex_base, scene_node, flags,
            material_base),
    ]
    .concat();

    let device = device();
    let pipeline = ComputePipeline::new(device, shader("words.comp", TABLE, 0), &[]).unwrap();
    let texels = |name, words: &Vec<f32>| {
        let kind = BufferKind::Texel(TexelFormat::Rgba32Uint);
        Buffer::new(device, name, kind, words.len() as u64 * 4).unwrap()
    };
    let bytes = expected.len() as u64 * 4;
    let fields = Buffer::new(device, "fields", BufferKind::Storage, bytes).unwrap();
    let back = Buffer::new(device, "back", BufferKind::Readback, bytes).unwrap();
    let sources = [("instances", &instances), ("materials", &materials), ("lights", &lights)];
    let buffers = sources.map(|(name, words)| (name, texels(name, words), words));
    let mut resources = vec![("Fields", Resource::Buffer(&fields))];
    resources.extend(buffers.iter().map(|(name, buffer, _)| (*name, Resource::Buffer(buffer))));
    let bindings = Bindings::new(&pipeline, &resources).unwrap();
    let mut recorder = Recorder::new(device, 0, "words").unwrap();
    for (_, buffer, words) in &buffers {
        recorder.upload(buffer, 0, bytemuck::cast_slice(words)).unwrap();
    }
    recorder.dispatch(&pipeline, &bindings, &[], [1, 1, 1]).unwrap();
    recorder.copy_buffer(&fields, 0, &back, 0, bytes).unwrap();
    device.submit(recorder.finish().unwrap(), &[]).unwrap().wait(Duration::from_secs(60)).unwrap();
    let found: Vec<u32> = bytemuck::pod_collect_to_vec(&back.read(0, bytes).unwrap());
    assert_eq!(found, expected);
    assert_validation_is_silent();
}

/// Every `const uint` and `const int` of the shared GLSL, which SPIR-V keeps no names of.
fn constants() -> BTreeMap<String, u32> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shaders-glsl/include");
    let mut all: BTreeMap<String, u32> = BTreeMap::new();
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    for file in files {
        for line in fs::read_to_string(&file).unwrap().lines() {
            let line = line.trim_start();
            let line =
                line.strip_prefix("layout(constant_id = ").and_then(|l| l.split_once(") ")).map_or(line, |l| l.1);
            let Some(rest) = line.strip_prefix("const uint ").or_else(|| line.strip_prefix("const int ")) else {
                continue;
            };
            let Some((name, rest)) = rest.split_once(" = ") else { continue };
            let Some((value, _)) = rest.split_once(';') else { continue };
            let term = |term: &str| {
                let digits = term.trim().trim_end_matches('u');
                let hex = digits.strip_prefix("0x").map(|hex| u32::from_str_radix(hex, 16).unwrap());
                hex.or_else(|| digits.parse().ok()).or_else(|| all.get(digits).copied())
            };
            if let Some(value) = value.split('|').map(term).reduce(|a, b| Some(a? | b?)).flatten() {
                all.insert(name.to_owned(), value);
            }
        }
    }
    all
}

#[test]
fn every_constant_is_its_twins() {
    let glsl = constants();
    for (name, value) in [
        ("NO_TEXTURE", NO_TEXTURE),
        ("ROLE_PROP", ROLE_PROP),
        ("ROLE_VIRTUAL", ROLE_VIRTUAL),
        ("ROLE_RASTER", ROLE_RASTER),
        ("ROLE_MASK", ROLE_MASK),
        ("INSTANCE_OPAQUE", INSTANCE_OPAQUE),
        ("PHYSICAL", PRIMARY_ROLES),
        ("EVERYTHING", SECONDARY_ROLES),
        ("LIGHT_DIRECTIONAL", LIGHT_DIRECTIONAL),
        ("LIGHT_POINT", LIGHT_POINT),
        ("LIGHT_SPOT", LIGHT_SPOT),
        ("MAX_VIEWERS", MAX_VIEWERS as u32),
        ("TILE_PX", TILE_PX),
        ("EDGE_TILES", EDGE_TILES as u32),
        ("LENS_NONE", LENS_NONE),
        ("LENS_BROWN_CONRADY", LENS_BROWN_CONRADY),
        ("LENS_WARP", LENS_WARP),
        ("LENS_STEPS", LENS_STEPS),
        ("MAX_BOXES", MAX_BOXES as u32),
        ("TILES_SEEN", TileList::Seen as u32),
        ("TILES_MARKED", TileList::Marked as u32),
        ("TILES_EDGED", TileList::Edged as u32),
        ("TILES_LIT", TileList::Lit as u32),
        ("TILES_SHARED", TileList::Shared as u32),
        ("TILE_LISTS", TILE_LISTS as u32),
        ("PATTERN_OFF", Pattern::Off as u32),
        ("PATTERN_GRID", Pattern::Grid as u32),
        ("PATTERN_WHITE", Pattern::White as u32),
        ("PATTERN_BLACK", Pattern::Black as u32),
        ("PATTERN_CHECKER", Pattern::Checker as u32),
        ("PATTERN_IDENTIFY", Pattern::Identify as u32),
        ("RAY_PRIMARY", RayKind::Primary as u32),
        ("RAY_SECONDARY", RayKind::Secondary as u32),
        ("RAY_VIRTUAL", RayKind::Virtual as u32),
        ("RAY_SHADOW", RayKind::Shadow as u32),
        ("RAY_BLEND", RayKind::Blend as u32),
        ("RAY_KINDS", RayKind::ALL.len() as u32),
    ] {
        assert_eq!(glsl.get(name), Some(&value), "{name}");
    }
}
