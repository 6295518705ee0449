//! What a caller gets wrong is answered, and never reaches the driver.

use std::sync::Arc;

use lantern_gpu::*;

use crate::common::*;

#[test]
fn buffers_refuse_sizes_and_ranges() {
    on_device(1, |device| {
        let limits = *device.limits();
        let new = |kind, bytes| Buffer::new(device, "b", kind, bytes);
        assert!(matches!(new(BufferKind::Storage, 0), Err(GpuError::Misuse { .. })));
        let error = new(BufferKind::Storage, limits.max_storage_buffer_bytes + 1).unwrap_err();
        assert!(matches!(error, GpuError::TooLarge { unit: "bytes of a storage buffer", .. }), "{error}");
        let elements = limits.max_texel_buffer_elements + 1;
        let error = new(BufferKind::Texel(TexelFormat::R32Uint), elements * 4).unwrap_err();
        assert!(matches!(error, GpuError::TooLarge { unit: "elements of a texel buffer", .. }), "{error}");
        assert!(matches!(new(BufferKind::Texel(TexelFormat::Rgba32Uint), 24), Err(GpuError::Misuse { .. })));

        for kind in [BufferKind::Readback, BufferKind::Staging] {
            for bytes in [limits.max_buffer_bytes.saturating_add(1), u64::MAX] {
                let error = new(kind, bytes).unwrap_err();
                assert!(matches!(error, GpuError::TooLarge { .. } | GpuError::Misuse { .. }), "{error}");
            }
        }

        let uniform = new(BufferKind::Uniform, 16).unwrap();
        for (offset, bytes) in [(0, 17), (16, 1), (u64::MAX, 1)] {
            let data = vec![0; bytes];
            assert!(matches!(uniform.write(offset, &data), Err(GpuError::Range { .. })), "{offset}, {bytes}");
            assert!(matches!(uniform.read(offset, bytes as u64), Err(GpuError::Range { .. })), "{offset}, {bytes}");
        }
        uniform.write(16, &[]).unwrap();
        let storage = new(BufferKind::Storage, 16).unwrap();
        assert!(matches!(storage.write(0, &[1]), Err(GpuError::Misuse { .. })));
        assert!(matches!(storage.read(0, 1), Err(GpuError::Misuse { .. })));
    });
}

#[test]
fn images_refuse_sizes_and_usages() {
    on_device(1, |device| {
        let new = |width, height, format, usage| Image::new(device, "i", width, height, format, usage);
        let too_wide = device.limits().max_image_px + 1;
        let color = ImageFormat::Rgba8Unorm;
        assert!(matches!(new(0, 4, color, ImageUsage::COLOR), Err(GpuError::Misuse { .. })));
        assert!(matches!(new(too_wide, 4, color, ImageUsage::STORAGE), Err(GpuError::TooLarge { .. })));
        assert!(matches!(new(4, too_wide, color, ImageUsage::COLOR), Err(GpuError::TooLarge { .. })));
        assert!(matches!(new(4, 4, color, ImageUsage::DEPTH), Err(GpuError::Misuse { .. })));
        assert!(matches!(new(4, 4, ImageFormat::Depth32, ImageUsage::COLOR), Err(GpuError::Misuse { .. })));
    });
}

#[test]
fn bindings_name_what_does_not_fit() {
    on_device(1, |device| {
        let buffer = storage(device, "buffer", &[0; 4]);
        let uniform = Buffer::new(device, "uniform", BufferKind::Uniform, 16).unwrap();
        let image = Image::new(device, "image", 4, 4, ImageFormat::Rgba8Unorm, ImageUsage::SAMPLED).unwrap();
        let pipeline = ComputePipeline::new(device, scale(), &[]).unwrap();
        let refused = |resources: &[(&str, Resource<'_>)], hint: &str| {
            let error = Bindings::new(&pipeline, resources).unwrap_err();
            assert!(matches!(error, GpuError::Binding { .. }) && error.to_string().contains(hint), "{error}");
        };
        let source = ("Source", Resource::Buffer(&buffer));
        refused(&[source], "\"Target\": not given");
        refused(&[source, ("Traget", Resource::Buffer(&buffer))], "there are Source, Target");
        refused(&[source, source], "given twice");
        refused(&[source, ("Target", Resource::Buffer(&uniform))], "it is a StorageBuffer");
        refused(&[source, ("Target", Resource::Image(&image))], "it is a StorageBuffer");

        let paint = ComputePipeline::new(device, paint(), &[]).unwrap();
        let error = Bindings::new(&paint, &[("canvas", Resource::Image(&image))]).unwrap_err();
        assert!(error.to_string().contains("it is a StorageImage"), "{error}");
    });
}

#[test]
fn tables_that_contradict_themselves_or_the_device_are_refused() {
    const OTHER_SET: &[Binding] = &[Binding { set: 1, ..row(0, "Data", BindingKind::StorageBuffer, true, true) }];
    const TWICE: &[Binding] = &[
        row(0, "Data", BindingKind::StorageBuffer, true, true),
        row(0, "data", BindingKind::UniformBuffer, true, false),
    ];
    on_device(1, |device| {
        let made = |shader| ComputePipeline::new(device, shader, &[]);
        for table in [OTHER_SET, TWICE] {
            let error = made(shader("step.comp", table, 0)).unwrap_err();
            assert!(matches!(error, GpuError::Binding { .. }), "{error}");
        }
        let error = made(shader("step.comp", &[], device.limits().max_push_bytes + 4)).unwrap_err();
        assert!(matches!(error, GpuError::TooLarge { unit: "bytes of push constants", .. }), "{error}");
        let error = made(shader("full.vert", &[], 8)).unwrap_err();
        assert!(matches!(error, GpuError::Misuse { .. }), "{error}");
        let error = ComputePipeline::new(device, scale(), &[(3, 1), (3, 2)]).unwrap_err();
        assert!(error.to_string().contains("constant 3 is given twice"), "{error}");
        let wide = Shader { local_size: [u32::MAX; 3], spirv: step().spirv, bindings: &[], ..*step() };
        assert!(matches!(made(Box::leak(Box::new(wide))), Err(GpuError::TooLarge { .. })));
        let garbage = Shader { spirv: &[1, 2, 3], bindings: &[], ..*step() };
        assert!(made(Box::leak(Box::new(garbage))).unwrap_err().to_string().contains("not spir-v"));
    });
}

#[test]
fn dispatches_and_copies_refuse_what_does_not_fit() {
    on_device(1, |device| {
        let buffer = storage(device, "buffer", &[0; 4]);
        let target = storage(device, "target", &[0; 4]);
        let pipeline = ComputePipeline::new(device, scale(), &[]).unwrap();
        let other = ComputePipeline::new(device, step(), &[]).unwrap();
        let resources = [("Source", Resource::Buffer(&buffer)), ("Target", Resource::Buffer(&target))];
        let bindings = Bindings::new(&pipeline, &resources).unwrap();
        let image = Image::new(device, "image", 4, 4, ImageFormat::Rgba8Unorm, ImageUsage::SAMPLED).unwrap();
        let copyable = Image::new(device, "copyable", 4, 4, ImageFormat::Rgba8Unorm, ImageUsage::TRANSFER).unwrap();
        let back = readback(device, 63);
        run(device, |recorder| {
            let error = recorder.dispatch(&pipeline, &bindings, &[0; 12], [1; 3]).unwrap_err();
            assert!(matches!(error, GpuError::PushConstants { given: 12, declared: 8, .. }), "{error}");
            let error = recorder.dispatch(&other, &bindings, &[], [1; 3]).unwrap_err();
            assert!(matches!(error, GpuError::Binding { .. }), "{error}");
            let many = device.limits().max_groups[0].checked_add(1);
            if let Some(many) = many {
                let error = recorder.dispatch(&pipeline, &bindings, &[0; 8], [many, 1, 1]).unwrap_err();
                assert!(matches!(error, GpuError::TooLarge { unit: "workgroups", .. }), "{error}");
            }
            assert!(matches!(recorder.copy_buffer(&buffer, 8, &target, 0, 9), Err(GpuError::Range { .. })));
            assert!(matches!(recorder.copy_buffer(&buffer, 0, &buffer, 4, 8), Err(GpuError::Misuse { .. })));
            assert!(matches!(recorder.upload(&buffer, 12, &[0; 5]), Err(GpuError::Range { .. })));
            assert!(matches!(recorder.copy_image_to_buffer(&image, &back), Err(GpuError::Misuse { .. })));
            assert!(matches!(recorder.copy_image_to_buffer(&copyable, &back), Err(GpuError::Range { .. })));
            let room = readback(device, 64);
            assert!(matches!(recorder.copy_image_to_buffer(&copyable, &room), Err(GpuError::Unwritten { .. })));
            assert_eq!(recorder.barriers(), 0, "a refused operation left a barrier");
        });
    });
}

#[test]
fn bindings_made_for_reading_do_not_serve_a_shader_that_writes() {
    const READS: &[Binding] = &[row(0, "Data", BindingKind::StorageBuffer, true, false)];
    on_device(1, |device| {
        let buffer = storage(device, "buffer", &[2; 64]);
        let writer = ComputePipeline::new(device, step(), &[]).unwrap();
        let reader = ComputePipeline::new(device, shader("peek.comp", READS, 0), &[]).unwrap();
        let for_writing = Bindings::new(&writer, &[("Data", Resource::Buffer(&buffer))]).unwrap();
        let for_reading = Bindings::new(&reader, &[("Data", Resource::Buffer(&buffer))]).unwrap();
        run(device, |recorder| {
            // The barrier before would know of a read alone.
            let error = recorder.dispatch(&writer, &for_reading, &[], [1; 3]).unwrap_err();
            assert!(matches!(error, GpuError::Binding { .. }), "{error}");
            recorder.dispatch(&reader, &for_writing, &[], [1; 3]).unwrap();
            recorder.dispatch(&writer, &for_writing, &[], [1; 3]).unwrap();
        });
        assert_eq!(words_of(device, &buffer)[3], 2 * 3 + 3);
    });
}

#[test]
fn objects_of_another_device_are_refused() {
    on_device(1, |device| {
        let instance = Instance::new(Validation::On).unwrap();
        let other = Device::open(&instance, None, 1, None).unwrap();
        let foreign = storage(&other, "foreign", &[0; 4]);
        let pipeline = ComputePipeline::new(device, step(), &[]).unwrap();
        let error = Bindings::new(&pipeline, &[("Data", Resource::Buffer(&foreign))]).unwrap_err();
        assert!(matches!(error, GpuError::OtherDevice { .. }), "{error}");
        let mut recorder = Recorder::new(device, 0, "mixed").unwrap();
        assert!(matches!(recorder.fill(&foreign, 0), Err(GpuError::OtherDevice { .. })));
        let commands = recorder.finish().unwrap();
        assert!(matches!(other.submit(commands, &[]), Err(GpuError::OtherDevice { .. })));
        drop((foreign, other));
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    });
}

#[test]
fn a_span_ends_in_the_recording_that_began_it() {
    on_device(1, |device| {
        let mut one = Recorder::new(device, 0, "one").unwrap();
        let mut two = Recorder::new(device, 0, "two").unwrap();
        let swapped = one.span("swap", |inside| {
            std::mem::swap(inside, &mut two);
            Ok(())
        });
        assert!(matches!(swapped, Err(GpuError::Misuse { .. })));
        assert!(one.finish().is_err());
    });
}

#[test]
fn a_rendering_left_by_a_panic_ends_the_recording() {
    on_device(1, |device| {
        let image = Image::new(device, "i", 4, 4, ImageFormat::Rgba8Unorm, ImageUsage::COLOR).unwrap();
        let mut recorder = Recorder::new(device, 0, "torn").unwrap();
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            recorder.render("torn", &[(&image, Load::Clear([0.0; 4]))], None, &[], |_| panic!("on purpose"))
        }));
        assert!(panicked.is_err());
        let buffer: Arc<Buffer> = Buffer::new(device, "b", BufferKind::Storage, 4).unwrap();
        assert!(matches!(recorder.fill(&buffer, 0), Err(GpuError::Misuse { .. })));
        assert!(recorder.finish().is_err());
    });
}

#[test]
fn memory_that_is_not_there_is_an_error_and_not_the_end() {
    on_device(1, |device| {
        let most = device.info().memory_heaps.iter().map(|heap| heap.bytes).max().unwrap_or(0);
        let asked = most.saturating_add(1 << 30) & !3;
        let error = Buffer::new(device, "all", BufferKind::Readback, asked).unwrap_err();
        assert!(matches!(error, GpuError::OutOfDeviceMemory { .. } | GpuError::TooLarge { .. }), "{error}");
        assert_eq!(device.allocated_bytes(), 0);
    });
}

#[test]
fn what_threads_share_may_be_shared() {
    fn shared<T: Send + Sync>() {}
    fn moved<T: Send>() {}
    shared::<Instance>();
    shared::<Device>();
    shared::<Buffer>();
    shared::<Image>();
    shared::<Bindings>();
    shared::<ComputePipeline>();
    shared::<GraphicsPipeline>();
    shared::<Submission>();
    moved::<Recorder>();
    moved::<Commands>();
}
