//! Compiles `shaders-glsl/` to SPIR-V and writes each shader's table (words, bindings, push constants, workgroup) as Rust.
//!
//! The compiler is `glslangValidator`, a package of a few hundred kilobytes that `packaging/` installs: the crates that
//! build a compiler from source cost one to ten minutes of every clean build.
#![expect(clippy::expect_used, reason = "a build script fails by panicking, and these say why it must not")]

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Dim, ExecutionMode, ExecutionModel, Op, StorageClass, Word};

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shaders-glsl");
    println!("cargo::rerun-if-changed={}", folder.display());
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets OUT_DIR"));

    // In sorted order, so that the output is the same on every machine.
    let mut sources: Vec<PathBuf> = fs::read_dir(&folder)
        .unwrap_or_else(|e| panic!("cannot read {}: {e}", folder.display()))
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|p| p.extension().is_some_and(|e| ["comp", "vert", "frag"].iter().any(|s| e == *s)))
        .collect();
    sources.sort();

    let mut rust = String::from("// Written by build.rs.\n");
    let (mut all, mut by_storage, mut by_ray_query) = (Vec::new(), Vec::new(), Vec::new());
    for source in &sources {
        let name = source.file_name().and_then(|n| n.to_str()).expect("shader names are ASCII").to_owned();
        let (words, module) = compile(source, &out.join(format!("{name}.spv")), &[]);
        write_table(&mut rust, &constant_name(&name), &name, &words, &module);

        // What reads the scene is built again for devices that do so through storage buffers.
        let (others, module) = compile(source, &out.join(format!("{name}.storage.spv")), &["-DSTORAGE_LOADS"]);
        if others != words {
            let constant = constant_name(&name) + "_BY_STORAGE";
            write_table(&mut rust, &constant, &format!("{name}, by storage buffers"), &others, &module);
            by_storage.push(format!("(&{}, &{constant})", constant_name(&name)));
        }

        // What traces is built a third time for ray queries, whose capability must stand in the code of whoever asks for them; not a
        // fourth, since devices with ray queries read through storage buffers. No pass but compute traces; where another could, by
        // a way that it never takes, it does not become another shader.
        let options = ["-DSTORAGE_LOADS", "-DRAY_QUERY"];
        let (words, module) = compile(source, &out.join(format!("{name}.ray_query.spv")), &options);
        let traces = Reflection::new(&module).bindings().values().any(|table| table.kind == "AccelerationStructure");
        if traces && name.ends_with(".comp") {
            let constant = constant_name(&name) + "_BY_RAY_QUERY";
            write_table(&mut rust, &constant, &format!("{name}, by ray query"), &words, &module);
            by_ray_query.push(format!("(&{}, &{constant})", constant_name(&name)));
        }
        all.push(constant_name(&name));
    }
    let _ = writeln!(
        rust,
        "/// What reads the scene, and the same through storage buffers.\nstatic BY_STORAGE: &[(&Shader, &Shader)] = &[{}];",
        by_storage.join(", ")
    );
    let _ = writeln!(
        rust,
        "/// What traces, and the same for devices with ray queries.\nstatic BY_RAY_QUERY: &[(&Shader, &Shader)] = &[{}];",
        by_ray_query.join(", ")
    );
    let _ = writeln!(rust, "/// Every shader, sorted by name.\npub static ALL: &[&Shader] = &[{}];", {
        all.iter().map(|n| format!("&{n}")).collect::<Vec<_>>().join(", ")
    });
    fs::write(out.join("shaders.rs"), rust).expect("OUT_DIR is writable");
}

/// `primary.comp` → `PRIMARY_COMP`.
fn constant_name(file: &str) -> String {
    file.replace('.', "_").to_uppercase()
}

fn compile(source: &Path, target: &Path, options: &[&str]) -> (Vec<Word>, Module) {
    let output = Command::new("glslangValidator")
        // SPIR-V 1.5: from 1.6 on the workgroup's size is an id, which needs a feature (maintenance4) for nothing.
        .args(["-V", "--quiet", "--target-env", "vulkan1.2"])
        .args(options)
        .arg("-o")
        .arg(target)
        .arg(source)
        .output()
        .unwrap_or_else(|e| {
            panic!("cannot run glslangValidator: {e}\nhint: install the package glslang-tools, as packaging/demo does")
        });
    if !output.status.success() {
        panic!("{} does not compile:\n{}", source.display(), String::from_utf8_lossy(&output.stdout));
    }
    let bytes = fs::read(target).expect("the compiler has written its output");
    let words: Vec<Word> = bytes.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
    let module =
        rspirv::dr::load_words(&words).unwrap_or_else(|e| panic!("{}: cannot parse its SPIR-V: {e}", source.display()));
    (words, module)
}

struct Table {
    set: u32,
    name: String,
    kind: &'static str,
    reads: bool,
    writes: bool,
}

/// What a module's entry point declares.
struct Reflection<'a> {
    module: &'a Module,
    types: HashMap<Word, &'a Instruction>,
    names: HashMap<Word, String>,
}

impl<'a> Reflection<'a> {
    fn new(module: &'a Module) -> Self {
        let types = module.types_global_values.iter().filter_map(|i| i.result_id.map(|id| (id, i))).collect();
        let names = module
            .debug_names
            .iter()
            .filter(|i| i.class.opcode == Op::Name)
            .filter_map(|i| match (&i.operands[0], &i.operands[1]) {
                (Operand::IdRef(id), Operand::LiteralString(s)) => Some((*id, s.clone())),
                _ => None,
            })
            .collect();
        Self { module, types, names }
    }

    fn decoration(&self, id: Word, wanted: Decoration) -> Option<u32> {
        self.module.annotations.iter().find_map(|i| match i.operands.as_slice() {
            [Operand::IdRef(t), Operand::Decoration(d), rest @ ..] if *t == id && *d == wanted => {
                Some(rest.first().map_or(0, literal))
            }
            _ => None,
        })
    }

    fn member_decorations(&self, id: Word, wanted: Decoration) -> BTreeMap<u32, u32> {
        self.module
            .annotations
            .iter()
            .filter_map(|i| match i.operands.as_slice() {
                [Operand::IdRef(t), Operand::LiteralBit32(m), Operand::Decoration(d), rest @ ..]
                    if *t == id && *d == wanted =>
                {
                    Some((*m, rest.first().map_or(0, literal)))
                }
                _ => None,
            })
            .collect()
    }

    /// The global variables that the entry point's call tree names: a binding that it does not reach is no binding of it.
    fn reached(&self) -> BTreeSet<Word> {
        let functions: HashMap<Word, &rspirv::dr::Function> =
            self.module.functions.iter().filter_map(|f| f.def_id().map(|id| (id, f))).collect();
        let mut waiting: Vec<Word> = self.module.entry_points.iter().map(|e| id_of(&e.operands[1])).collect();
        let (mut seen, mut used) = (BTreeSet::new(), BTreeSet::new());
        while let Some(function) = waiting.pop() {
            if !seen.insert(function) {
                continue;
            }
            for instruction in functions[&function].blocks.iter().flat_map(|b| &b.instructions) {
                for operand in &instruction.operands {
                    if let Operand::IdRef(id) = operand {
                        used.insert(*id);
                        if functions.contains_key(id) {
                            waiting.push(*id);
                        }
                    }
                }
            }
        }
        used
    }

    /// Variables with their pointed-at type.
    fn variables(&self) -> impl Iterator<Item = (Word, StorageClass, Word)> + '_ {
        self.module.types_global_values.iter().filter(|i| i.class.opcode == Op::Variable).filter_map(|i| {
            let pointer = self.types[&i.result_type?];
            let Operand::StorageClass(class) = i.operands[0] else { return None };
            Some((i.result_id?, class, id_of(&pointer.operands[1])))
        })
    }

    fn bindings(&self) -> BTreeMap<u32, Table> {
        let reached = self.reached();
        let mut found = BTreeMap::new();
        for (id, class, ty) in self.variables().filter(|(id, ..)| reached.contains(id)) {
            let Some(binding) = self.decoration(id, Decoration::Binding) else { continue };
            let set = self.decoration(id, Decoration::DescriptorSet).unwrap_or(0);
            let type_name = || self.names[&ty].clone();
            let name = || self.names[&id].clone();
            let table = match class {
                StorageClass::StorageBuffer => {
                    let members = self.types[&ty].operands.len();
                    let all = |d| self.member_decorations(ty, d).len() == members;
                    let (reads, writes) = (!all(Decoration::NonReadable), !all(Decoration::NonWritable));
                    Table { set, name: type_name(), kind: "StorageBuffer", reads, writes }
                }
                StorageClass::Uniform => {
                    Table { set, name: type_name(), kind: "UniformBuffer", reads: true, writes: false }
                }
                StorageClass::UniformConstant => {
                    Table { set, name: name(), kind: self.opaque_kind(ty), reads: true, writes: false }
                }
                _ => continue,
            };
            found.insert(binding, table);
        }
        found
    }

    fn opaque_kind(&self, ty: Word) -> &'static str {
        let declared = self.types[&ty];
        if declared.class.opcode == Op::TypeAccelerationStructureKHR {
            return "AccelerationStructure";
        }
        let (image, combined) = match declared.class.opcode {
            Op::TypeSampledImage => (self.types[&id_of(&declared.operands[0])], true),
            _ => (declared, false),
        };
        let buffer = matches!(image.operands[1], Operand::Dim(Dim::DimBuffer));
        match (buffer, combined) {
            (true, true) => "UniformTexelBuffer",
            (false, true) => "SampledImage",
            _ => "StorageImage",
        }
    }

    /// Bytes of the push-constant block.
    fn push_bytes(&self) -> u32 {
        let reached = self.reached();
        self.variables()
            .find(|(id, class, _)| *class == StorageClass::PushConstant && reached.contains(id))
            .map_or(0, |(_, _, ty)| self.size_of(ty))
    }

    fn size_of(&self, ty: Word) -> u32 {
        let declared = self.types[&ty];
        match declared.class.opcode {
            Op::TypeInt | Op::TypeFloat => literal(&declared.operands[0]) / 8,
            Op::TypeVector => self.size_of(id_of(&declared.operands[0])) * literal(&declared.operands[1]),
            Op::TypeStruct => {
                let offsets = self.member_decorations(ty, Decoration::Offset);
                let ends =
                    declared.operands.iter().enumerate().map(|(m, t)| offsets[&(m as u32)] + self.size_of(id_of(t)));
                ends.max().unwrap_or(0)
            }
            other => panic!("push constants of type {other:?} are not handled"),
        }
    }

    fn local_size(&self) -> [u32; 3] {
        self.module
            .execution_modes
            .iter()
            .find(|i| matches!(i.operands[1], Operand::ExecutionMode(ExecutionMode::LocalSize)))
            .map_or([1; 3], |i| [literal(&i.operands[2]), literal(&i.operands[3]), literal(&i.operands[4])])
    }
}

fn id_of(operand: &Operand) -> Word {
    match operand {
        Operand::IdRef(id) => *id,
        other => panic!("expected an id, found {other:?}"),
    }
}

fn literal(operand: &Operand) -> u32 {
    match operand {
        Operand::LiteralBit32(value) => *value,
        other => panic!("expected a literal, found {other:?}"),
    }
}

fn write_table(rust: &mut String, constant: &str, name: &str, words: &[Word], module: &Module) {
    let reflection = Reflection::new(module);
    let stage = match module.entry_points[0].operands[0] {
        Operand::ExecutionModel(ExecutionModel::GLCompute) => "Compute",
        Operand::ExecutionModel(ExecutionModel::Vertex) => "Vertex",
        Operand::ExecutionModel(ExecutionModel::Fragment) => "Fragment",
        ref other => panic!("{name}: unexpected entry point {other:?}"),
    };
    let bindings: String = reflection
        .bindings()
        .iter()
        .map(|(binding, t)| {
            format!(
                "Binding {{ set: {}, binding: {binding}, name: {:?}, kind: BindingKind::{}, reads: {}, writes: {} }}, ",
                t.set, t.name, t.kind, t.reads, t.writes
            )
        })
        .collect();
    let _ = writeln!(
        rust,
        "/// `shaders-glsl/{name}`.\npub static {constant}: Shader = Shader {{ name: {name:?}, stage: Stage::{stage}, spirv: &{words:?}, bindings: &[{bindings}], push_bytes: {}, local_size: {:?} }};",
        reflection.push_bytes(),
        reflection.local_size(),
    );
}
