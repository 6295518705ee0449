//! Renderings with colour and depth, read back.

use std::sync::Arc;

use lantern_gpu::*;

use crate::common::*;

const VERTEX: &[Binding] = &[];
const FRAGMENT: &[Binding] = &[row(0, "Source", BindingKind::StorageBuffer, true, false)];
const COLORS: &[ImageFormat] = &[ImageFormat::Rgba32Float, ImageFormat::R32Uint];
const SIZE: [u32; 2] = [16, 9];

fn pipeline(device: &Arc<Device>, depth_test: DepthTest) -> Arc<GraphicsPipeline> {
    let desc = GraphicsDesc {
        name: "full",
        vertex: shader("full.vert", VERTEX, 8),
        fragment: shader("full.frag", FRAGMENT, 8),
        constants: &[],
        colors: COLORS,
        depth: Some(ImageFormat::Depth32),
        depth_test,
    };
    GraphicsPipeline::new(device, &desc).unwrap()
}

struct Targets {
    color: Arc<Image>,
    word: Arc<Image>,
    depth: Arc<Image>,
}

fn targets(device: &Arc<Device>) -> Targets {
    let image = |name, format, usage| Image::new(device, name, SIZE[0], SIZE[1], format, usage).unwrap();
    Targets {
        color: image("color", COLORS[0], ImageUsage::COLOR | ImageUsage::TRANSFER),
        word: image("word", COLORS[1], ImageUsage::COLOR | ImageUsage::TRANSFER),
        depth: image("depth", ImageFormat::Depth32, ImageUsage::DEPTH | ImageUsage::TRANSFER | ImageUsage::SAMPLED),
    }
}

fn bind(pipeline: &Arc<GraphicsPipeline>, source: &Arc<Buffer>) -> Arc<Bindings> {
    Bindings::new(pipeline, &[("Source", Resource::Buffer(source))]).unwrap()
}

fn push(depth: f32, shade: f32) -> Vec<u8> {
    bytemuck::cast_slice(&[depth, shade]).to_vec()
}

#[test]
fn a_full_triangle_writes_colour_and_depth_after_compute_made_its_input() {
    on_device(1, |device| {
        let data = storage(device, "data", &[1, 2, 3, 4]);
        let advance = ComputePipeline::new(device, step(), &[]).unwrap();
        let advanced = Bindings::new(&advance, &[("Data", Resource::Buffer(&data))]).unwrap();
        let draw = pipeline(device, DepthTest::Less);
        let drawn = bind(&draw, &data);
        let targets = targets(device);
        let color = readback(device, targets.color.bytes());
        let word = readback(device, targets.word.bytes());
        let depth = readback(device, targets.depth.bytes());
        run(device, |recorder| {
            recorder.dispatch(&advance, &advanced, &[], [1, 1, 1]).unwrap();
            let colors = [(&targets.color, Load::Clear([0.0; 4])), (&targets.word, Load::Clear([7.0; 4]))];
            let depth_target = Some((&targets.depth, Load::Clear([1.0; 4])));
            recorder
                .render("triangle", &colors, depth_target, &[&drawn], |draws| {
                    draws.draw(&draw, &drawn, &push(0.25, 0.5), 3, 1)?;
                    // Behind the first: the depth test keeps it out.
                    draws.draw(&draw, &drawn, &push(0.5, 0.75), 3, 1)
                })
                .unwrap();
            recorder.copy_image_to_buffer(&targets.color, &color).unwrap();
            recorder.copy_image_to_buffer(&targets.word, &word).unwrap();
            recorder.copy_image_to_buffer(&targets.depth, &depth).unwrap();
        });

        let stepped = [3, 7, 11, 15];
        let (color, word, depth) = (floats(&color), words(&word), floats(&depth));
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let at = (y * SIZE[0] + x) as usize;
                let center = [x as f32 + 0.5, y as f32 + 0.5];
                assert_eq!(color[at * 4..at * 4 + 4], [0.5, center[0], center[1], 3.0], "at {x}, {y}");
                assert_eq!(word[at], stepped[x as usize % 4]);
                assert_eq!(depth[at], 0.25 + center[0] / 1024.0);
            }
        }
    });
}

#[test]
fn a_rendering_keeps_what_it_uses_until_it_is_done() {
    on_device(1, |device| {
        let color = readback(device, 16 * 9 * 16);
        let commands = {
            let data = storage(device, "data", &[5]);
            let draw = pipeline(device, DepthTest::Less);
            let drawn = bind(&draw, &data);
            let targets = targets(device);
            let clear = Load::Clear([1.0; 4]);
            let mut recorder = Recorder::new(device, 0, "orphan").unwrap();
            let colors = [(&targets.color, clear), (&targets.word, clear)];
            recorder
                .render("triangle", &colors, Some((&targets.depth, clear)), &[&drawn], |draws| {
                    draws.draw(&draw, &drawn, &push(0.25, 0.5), 3, 1)
                })
                .unwrap();
            recorder.copy_image_to_buffer(&targets.color, &color).unwrap();
            recorder.finish().unwrap()
        };
        device.submit(commands, &[]).unwrap().wait(TIMEOUT).unwrap();
        assert_eq!(floats(&color)[..4], [0.5, 0.5, 0.5, 5.0]);
        assert!(
            device.allocated_bytes() <= color.bytes() + 1024,
            "the readback alone is left: {}",
            device.allocated_bytes()
        );
    });
}

#[test]
fn what_is_kept_is_tested_against_in_the_next_rendering() {
    on_device(1, |device| {
        let data = storage(device, "data", &[1]);
        let (less, equal, always) = (
            pipeline(device, DepthTest::Less),
            pipeline(device, DepthTest::LessOrEqual),
            pipeline(device, DepthTest::Always),
        );
        let bindings = bind(&less, &data);
        let targets = targets(device);
        let color = readback(device, targets.color.bytes());
        // Each step: pipeline, depth, shade, and the shade that stays.
        let steps = [
            (&less, 0.5, 0.1, 0.1),
            (&less, 0.5, 0.2, 0.1),
            (&equal, 0.5, 0.3, 0.3),
            (&always, 0.75, 0.4, 0.4),
            (&less, 0.6, 0.5, 0.5),
        ];
        for (at, (pipeline, depth, shade, stays)) in steps.into_iter().enumerate() {
            let load = if at == 0 { Load::Clear([1.0; 4]) } else { Load::Keep };
            run(device, |recorder| {
                let colors = [(&targets.color, load), (&targets.word, load)];
                recorder
                    .render("step", &colors, Some((&targets.depth, load)), &[&bindings], |draws| {
                        draws.draw(pipeline, &bindings, &push(depth, shade), 3, 1)
                    })
                    .unwrap();
                recorder.copy_image_to_buffer(&targets.color, &color).unwrap();
            });
            assert_eq!(floats(&color)[0], stays, "step {at}");
        }
    });
}

#[test]
fn a_rendering_without_draws_clears_integers_and_depth() {
    on_device(1, |device| {
        let targets = targets(device);
        let word = readback(device, targets.word.bytes());
        let depth = readback(device, targets.depth.bytes());
        run(device, |recorder| {
            let colors = [(&targets.word, Load::Clear([u32::MAX as f32, 0.0, 0.0, 0.0]))];
            let cleared = Some((&targets.depth, Load::Clear([f32::NAN; 4])));
            recorder.render("clear", &colors, cleared, &[], |_| Ok(())).unwrap();
            recorder.copy_image_to_buffer(&targets.word, &word).unwrap();
            recorder.copy_image_to_buffer(&targets.depth, &depth).unwrap();
        });
        assert!(words(&word).iter().all(|&word| word == u32::MAX));
        assert!(floats(&depth).iter().all(|&depth| depth == 1.0));
    });
}

#[test]
fn depth_is_sampled_and_read_back() {
    on_device(1, |device| {
        let targets = targets(device);
        let picked = storage(device, "picked", &[0; 17 * 9]);
        let pick = ComputePipeline::new(device, pick(), &[(0, 0)]).unwrap();
        let resources = [("picture", Resource::Image(&targets.depth)), ("Target", Resource::Buffer(&picked))];
        let bindings = Bindings::new(&pick, &resources).unwrap();
        let back = readback(device, targets.depth.bytes());
        run(device, |recorder| {
            recorder.render("clear", &[], Some((&targets.depth, Load::Clear([0.625; 4]))), &[], |_| Ok(())).unwrap();
            recorder.dispatch(&pick, &bindings, &[], [3, 2, 1]).unwrap();
            recorder.copy_image_to_buffer(&targets.depth, &back).unwrap();
            // And back to where it began, over the reads.
            recorder.render("clear", &[], Some((&targets.depth, Load::Keep)), &[], |_| Ok(())).unwrap();
        });
        assert!(floats(&back).iter().all(|&depth| depth == 0.625));
        let picked = words_of(device, &picked);
        assert!(picked.iter().all(|&word| f32::from_bits(word) == 0.625));
    });
}

#[test]
fn renderings_refuse_what_does_not_fit() {
    on_device(1, |device| {
        let data = storage(device, "data", &[1]);
        let draw = pipeline(device, DepthTest::Less);
        let (bindings, others) = (bind(&draw, &data), bind(&draw, &data));
        let targets = targets(device);
        let clear = Load::Clear([0.0; 4]);
        let small = Image::new(device, "small", 4, 4, ImageFormat::R32Uint, ImageUsage::COLOR).unwrap();
        run(device, |recorder| {
            let mut refused = |colors: &[(&Arc<Image>, Load)], depth: Option<(&Arc<Image>, Load)>, hint: &str| {
                let error = recorder.render("bad", colors, depth, &[], |_| Ok(())).unwrap_err().to_string();
                assert!(error.contains(hint), "{error}");
            };
            refused(&[], None, "without an attachment");
            refused(&[(&targets.color, clear), (&small, clear)], None, "differ in size");
            refused(&[(&targets.color, clear), (&targets.color, clear)], None, "twice a target");
            refused(&[(&targets.depth, clear)], None, "a colour attachment");
            refused(&[], Some((&targets.color, clear)), "a depth attachment");
            refused(&[(&targets.color, Load::Keep)], None, "nothing has written it");

            let colors = [(&targets.color, clear), (&targets.word, clear)];
            let error = recorder
                .render("no depth", &colors, None, &[&bindings], |draws| {
                    draws.draw(&draw, &bindings, &push(0.0, 0.0), 3, 1)
                })
                .unwrap_err();
            assert!(error.to_string().contains("made for attachments"), "{error}");
            let depth = Some((&targets.depth, clear));
            let error = recorder
                .render("others", &colors, depth, &[&bindings], |draws| {
                    draws.draw(&draw, &others, &push(0.0, 0.0), 3, 1)
                })
                .unwrap_err();
            assert!(error.to_string().contains("not told of"), "{error}");
            let error = recorder
                .render("push", &colors, depth, &[&bindings], |draws| draws.draw(&draw, &bindings, &[0; 4], 3, 1))
                .unwrap_err();
            assert!(matches!(error, GpuError::PushConstants { given: 4, declared: 8, .. }), "{error}");
        });
    });
}
