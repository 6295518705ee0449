//! A device under validation, and shaders compiled for the tests.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use lantern_gpu::*;

/// Longer than any test works, also on a machine that is busy with others.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(60);

/// Runs `test` on the best device, closes it, and demands that the validation layer had nothing to say.
pub(crate) fn on_device(queues: u32, test: impl FnOnce(&Arc<Device>)) {
    let instance = Instance::new(Validation::On).unwrap();
    let device = Device::open(&instance, None, queues, None).unwrap();
    test(&device);
    // Objects that outlive their device would be heard of when it is closed, so it is closed before the question.
    assert_eq!(Arc::strong_count(&device), 1, "the test keeps something of the device");
    drop(device);
    assert_eq!(instance.validation_messages(), Vec::<String>::new());
}

/// Records with `record`, submits to queue 0, and waits.
pub(crate) fn run(device: &Arc<Device>, record: impl FnOnce(&mut Recorder)) -> Submission {
    let mut recorder = Recorder::new(device, 0, "test").unwrap();
    record(&mut recorder);
    let submission = device.submit(recorder.finish().unwrap(), &[]).unwrap();
    submission.wait(TIMEOUT).unwrap();
    submission
}

/// A storage buffer that holds `words`.
pub(crate) fn storage(device: &Arc<Device>, name: &str, words: &[u32]) -> Arc<Buffer> {
    let buffer = Buffer::new(device, name, BufferKind::Storage, words.len() as u64 * 4).unwrap();
    run(device, |recorder| recorder.upload(&buffer, 0, bytemuck::cast_slice(words)).unwrap());
    buffer
}

/// A buffer to read `bytes` bytes back.
pub(crate) fn readback(device: &Arc<Device>, bytes: u64) -> Arc<Buffer> {
    Buffer::new(device, "readback", BufferKind::Readback, bytes).unwrap()
}

/// What a device buffer holds.
pub(crate) fn words_of(device: &Arc<Device>, buffer: &Arc<Buffer>) -> Vec<u32> {
    let back = readback(device, buffer.bytes());
    run(device, |recorder| recorder.copy_buffer(buffer, 0, &back, 0, buffer.bytes()).unwrap());
    words(&back)
}

/// What a mapped buffer holds.
pub(crate) fn words(buffer: &Buffer) -> Vec<u32> {
    bytemuck::allocation::pod_collect_to_vec(&buffer.read(0, buffer.bytes()).unwrap())
}

/// What a mapped buffer holds.
pub(crate) fn floats(buffer: &Buffer) -> Vec<f32> {
    bytemuck::allocation::pod_collect_to_vec(&buffer.read(0, buffer.bytes()).unwrap())
}

/// Compiles a shader of the tests. Its table is written by hand here, where a build script would reflect it.
pub(crate) fn shader(file: &'static str, bindings: &'static [Binding], push_bytes: u32) -> &'static Shader {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/gpu/shaders").join(file);
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("shader.spv");
    let output = Command::new("glslangValidator")
        .args(["-V", "--target-env", "vulkan1.3", "-o"])
        .args([&target, &source])
        .output()
        .expect("the tests need glslangValidator; hint: apt install glslang-tools");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    let spirv: Vec<u32> = bytemuck::allocation::pod_collect_to_vec(&std::fs::read(&target).unwrap());

    let stage = match file.rsplit('.').next() {
        Some("vert") => Stage::Vertex,
        Some("frag") => Stage::Fragment,
        _ => Stage::Compute,
    };
    let side = if matches!(file, "paint.comp" | "pick.comp") { [8, 8, 1] } else { [64, 1, 1] };
    let local_size = if stage == Stage::Compute { side } else { [1; 3] };
    // Shaders are static in the program; a test leaks the few that it makes.
    Box::leak(Box::new(Shader { name: file, stage, spirv: spirv.leak(), bindings, push_bytes, local_size }))
}

/// A row of a table.
pub(crate) const fn row(binding: u32, name: &'static str, kind: BindingKind, reads: bool, writes: bool) -> Binding {
    Binding { set: 0, binding, name, kind, reads, writes }
}

/// `scale.comp`.
pub(crate) fn scale() -> &'static Shader {
    const TABLE: &[Binding] = &[
        row(0, "Source", BindingKind::StorageBuffer, true, false),
        row(2, "Target", BindingKind::StorageBuffer, false, true),
    ];
    shader("scale.comp", TABLE, 8)
}

/// `step.comp`.
pub(crate) fn step() -> &'static Shader {
    const TABLE: &[Binding] = &[row(0, "Data", BindingKind::StorageBuffer, true, true)];
    shader("step.comp", TABLE, 0)
}

/// `paint.comp`.
pub(crate) fn paint() -> &'static Shader {
    const TABLE: &[Binding] = &[row(0, "canvas", BindingKind::StorageImage, false, true)];
    shader("paint.comp", TABLE, 0)
}

/// `pick.comp`.
pub(crate) fn pick() -> &'static Shader {
    const TABLE: &[Binding] = &[
        row(0, "picture", BindingKind::SampledImage, true, false),
        row(1, "Target", BindingKind::StorageBuffer, false, true),
    ];
    shader("pick.comp", TABLE, 0)
}
