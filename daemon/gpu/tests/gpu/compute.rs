//! Dispatches through every kind of binding.

use lantern_gpu::*;

use crate::common::*;

#[test]
fn storage_push_and_specialisation_constants_reach_the_shader() {
    on_device(1, |device| {
        let source: Vec<u32> = (0..1000).collect();
        let input = storage(device, "input", &source);
        let output = storage(device, "output", &[7; 1000]);
        for factor in [5, 11] {
            let pipeline = ComputePipeline::new(device, scale(), &[(3, factor)]).unwrap();
            let resources = [("Target", Resource::Buffer(&output)), ("Source", Resource::Buffer(&input))];
            let bindings = Bindings::new(&pipeline, &resources).unwrap();
            let push: [u32; 2] = [900, 42];
            run(device, |recorder| {
                recorder.dispatch(&pipeline, &bindings, bytemuck::cast_slice(&push), [16, 1, 1]).unwrap();
            });
            let result = words_of(device, &output);
            for (i, &word) in result.iter().enumerate() {
                let expected = if i < 900 { i as u32 * factor + 42 } else { 7 };
                assert_eq!(word, expected, "element {i}, factor {factor}");
            }
        }
    });
}

#[test]
fn texel_and_uniform_buffers_reach_the_shader() {
    const TABLE: &[Binding] = &[
        row(0, "words", BindingKind::UniformTexelBuffer, true, false),
        row(1, "floats", BindingKind::UniformTexelBuffer, true, false),
        row(2, "numbers", BindingKind::UniformTexelBuffer, true, false),
        row(3, "Params", BindingKind::UniformBuffer, true, false),
        row(4, "Target", BindingKind::StorageBuffer, false, true),
    ];
    on_device(1, |device| {
        let texels = |name, format: TexelFormat, data: &[u8]| {
            let buffer = Buffer::new(device, name, BufferKind::Texel(format), data.len() as u64).unwrap();
            run(device, |recorder| recorder.upload(&buffer, 0, data).unwrap());
            buffer
        };
        let words: Vec<[u32; 4]> = (0..100).map(|i| [i, i + 1, 1, 2]).collect();
        let floats: Vec<[f32; 4]> = (0..100).map(|i| [0.0, (i % 7) as f32, 0.0, 0.0]).collect();
        let numbers: Vec<u32> = (0..100).map(|i| i + 50).collect();
        let words_buffer = texels("words", TexelFormat::Rgba32Uint, bytemuck::cast_slice(&words));
        let floats_buffer = texels("floats", TexelFormat::Rgba32Float, bytemuck::cast_slice(&floats));
        let numbers_buffer = texels("numbers", TexelFormat::R32Uint, bytemuck::cast_slice(&numbers));
        let params = Buffer::new(device, "params", BufferKind::Uniform, 16).unwrap();
        params.write(0, bytemuck::cast_slice(&[9u32, 9, 9, 9])).unwrap();
        let output = storage(device, "output", &[0; 100]);

        let pipeline = ComputePipeline::new(device, shader("gather.comp", TABLE, 0), &[]).unwrap();
        let resources = [
            ("words", Resource::Buffer(&words_buffer)),
            ("floats", Resource::Buffer(&floats_buffer)),
            ("numbers", Resource::Buffer(&numbers_buffer)),
            ("Params", Resource::Buffer(&params)),
            ("Target", Resource::Buffer(&output)),
        ];
        let bindings = Bindings::new(&pipeline, &resources).unwrap();
        let mut recorder = Recorder::new(device, 0, "gather").unwrap();
        recorder.dispatch(&pipeline, &bindings, &[], [2, 1, 1]).unwrap();
        // What the host writes until the submission is what the shader sees: so a pose may come late.
        params.write(0, bytemuck::cast_slice(&[1u32, 10, 100, 0])).unwrap();
        device.submit(recorder.finish().unwrap(), &[]).unwrap().wait(TIMEOUT).unwrap();

        for (i, &word) in words_of(device, &output).iter().enumerate() {
            let i = i as u32;
            let expected = i + 10 * (i + 1) + 100 + (i % 7) * 1000 + (i + 50) * 1_000_000;
            assert_eq!(word, expected, "element {i}");
        }
    });
}

#[test]
fn dependent_dispatches_see_what_came_before_and_cost_one_barrier_each() {
    on_device(1, |device| {
        let start: Vec<u32> = (0..500).map(|i| i * 17).collect();
        let data = storage(device, "data", &start);
        let pipeline = ComputePipeline::new(device, step(), &[]).unwrap();
        let bindings = Bindings::new(&pipeline, &[("Data", Resource::Buffer(&data))]).unwrap();
        run(device, |recorder| {
            for done in 0..10 {
                recorder.dispatch(&pipeline, &bindings, &[], [8, 1, 1]).unwrap();
                assert_eq!(recorder.barriers(), done + 1);
            }
        });
        for (i, &word) in words_of(device, &data).iter().enumerate() {
            let expected = (0..10).fold(start[i], |x, _| x.wrapping_mul(3).wrapping_add(i as u32));
            assert_eq!(word, expected, "element {i}");
        }
    });
}

#[test]
fn dispatches_without_a_hazard_need_no_barrier() {
    on_device(1, |device| {
        let input = storage(device, "input", &[3; 64]);
        let outputs: Vec<_> = (0..4).map(|i| storage(device, &format!("output {i}"), &[0; 64])).collect();
        let pipeline = ComputePipeline::new(device, scale(), &[]).unwrap();
        let bind = |from, to| {
            Bindings::new(&pipeline, &[("Source", Resource::Buffer(from)), ("Target", Resource::Buffer(to))]).unwrap()
        };
        let push: [u32; 2] = [64, 1];
        run(device, |recorder| {
            // The uploads were in other recordings: one barrier lets all dispatches read and overwrite them.
            for output in &outputs {
                let bindings = bind(&input, output);
                recorder.dispatch(&pipeline, &bindings, bytemuck::cast_slice(&push), [1, 1, 1]).unwrap();
                assert_eq!(recorder.barriers(), 1);
            }
            // The first output becomes an input: one more, which holds for the second output as well.
            for from in &outputs[..2] {
                let bindings = bind(from, &outputs[3]);
                recorder.dispatch(&pipeline, &bindings, bytemuck::cast_slice(&push), [1, 1, 1]).unwrap();
            }
            // 1 + read after write + write after write of output 3.
            assert_eq!(recorder.barriers(), 3);
        });
        assert_eq!(words_of(device, &outputs[3]), [5; 64]);
    });
}

#[test]
fn a_storage_image_is_sampled_nearest_and_clamped() {
    on_device(1, |device| {
        let (width, height) = (19, 11);
        let usage = ImageUsage::STORAGE | ImageUsage::SAMPLED | ImageUsage::TRANSFER;
        let image = Image::new(device, "canvas", width, height, ImageFormat::Rgba32Float, usage).unwrap();
        let target = storage(device, "picked", &[0; 20 * 11]);
        let paint = ComputePipeline::new(device, paint(), &[]).unwrap();
        let pick = ComputePipeline::new(device, pick(), &[]).unwrap();
        let painted = Bindings::new(&paint, &[("canvas", Resource::Image(&image))]).unwrap();
        let resources = [("picture", Resource::Image(&image)), ("Target", Resource::Buffer(&target))];
        let picked = Bindings::new(&pick, &resources).unwrap();
        let back = readback(device, image.bytes());
        run(device, |recorder| {
            for _ in 0..2 {
                recorder.dispatch(&paint, &painted, &[], [3, 2, 1]).unwrap();
                recorder.dispatch(&pick, &picked, &[], [3, 2, 1]).unwrap();
            }
            let before = recorder.barriers();
            recorder.copy_image_to_buffer(&image, &back).unwrap();
            assert_eq!(recorder.barriers(), before + 1);
        });
        let copied = floats(&back);
        let sampled: Vec<f32> = words_of(device, &target).into_iter().map(f32::from_bits).collect();
        for y in 0..height {
            for x in 0..=width {
                let expected = (x.min(width - 1) * 100 + y) as f32;
                assert_eq!(sampled[(y * (width + 1) + x) as usize], expected, "sampled at {x}, {y}");
                if x < width {
                    assert_eq!(copied[((y * width + x) * 4 + 2) as usize], expected, "copied at {x}, {y}");
                }
            }
        }
    });
}

#[test]
fn uploads_fills_and_copies_keep_their_order() {
    on_device(1, |device| {
        let a = Buffer::new(device, "a", BufferKind::Storage, 64).unwrap();
        let b = Buffer::new(device, "b", BufferKind::Storage, 64).unwrap();
        let back = readback(device, 64);
        run(device, |recorder| {
            recorder.fill(&a, 1).unwrap();
            recorder.upload(&a, 8, bytemuck::cast_slice(&[2u32, 3])).unwrap();
            recorder.copy_buffer(&a, 0, &b, 0, 64).unwrap();
            recorder.fill(&a, 9).unwrap();
            recorder.copy_buffer(&b, 0, &b, 32, 16).unwrap();
            recorder.copy_buffer(&b, 0, &back, 0, 64).unwrap();
        });
        assert_eq!(words(&back), [1, 1, 2, 3, 1, 1, 1, 1, 1, 1, 2, 3, 1, 1, 1, 1]);
        assert_eq!(words_of(device, &a), [9; 16]);
    });
}

#[test]
fn spans_are_monotone_and_nested() {
    on_device(1, |device| {
        let data = storage(device, "data", &[0; 64]);
        let pipeline = ComputePipeline::new(device, step(), &[]).unwrap();
        let bindings = Bindings::new(&pipeline, &[("Data", Resource::Buffer(&data))]).unwrap();
        let submission = run(device, |recorder| {
            recorder
                .span("outer", |recorder| {
                    for name in ["first", "second"] {
                        recorder.span(name, |recorder| recorder.dispatch(&pipeline, &bindings, &[], [1, 1, 1]))?;
                    }
                    Ok(())
                })
                .unwrap();
        });
        assert!(submission.is_done().unwrap());
        let spans = submission.spans();
        assert_eq!(device.info().abilities["timestamps"], !spans.is_empty());
        if let [first, second, outer] = spans[..] {
            assert_eq!([first.0, second.0, outer.0], ["first", "second", "outer"]);
            let times = [0.0, outer.1, first.1, first.2, second.1, second.2, outer.2];
            assert!(times.is_sorted(), "{times:?}");
            assert!(outer.2 < TIMEOUT.as_secs_f64() * 1e3 && outer.2 > outer.1);
        } else {
            assert!(spans.is_empty(), "{spans:?}");
        }
    });
}

#[test]
fn a_recording_has_room_for_127_spans_and_says_when_it_is_full() {
    on_device(1, |device| {
        let submission = run(device, |recorder| {
            for _ in 0..126 {
                recorder.span("one", |_| Ok(())).unwrap();
            }
            let inner = recorder.span("last", |recorder| {
                assert!(matches!(recorder.span("too many", |_| Ok(())), Err(GpuError::Misuse { .. })));
                Ok(())
            });
            inner.unwrap();
        });
        if device.info().abilities["timestamps"] {
            assert_eq!(submission.spans().len(), 127);
        }
    });
}

#[test]
fn a_shader_may_bind_nothing() {
    on_device(1, |device| {
        let pipeline = ComputePipeline::new(device, shader("nothing.comp", &[], 0), &[]).unwrap();
        let bindings = Bindings::new(&pipeline, &[]).unwrap();
        let submission = run(device, |recorder| {
            recorder.span("nothing", |recorder| recorder.dispatch(&pipeline, &bindings, &[], [1, 1, 1])).unwrap();
            assert_eq!(recorder.barriers(), 0);
        });
        assert!(submission.is_done().unwrap());
    });
}
