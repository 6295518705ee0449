//! Ray queries, where the device has them; what is refused where it does not.

use std::sync::Arc;

use lantern_gpu::*;

use crate::common::*;

/// A square of two triangles, 2 × 2, at height 0; the first is the one toward −x and −z.
const CORNERS: [[f32; 3]; 4] = [[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]];
const TRIANGLES: [[u32; 3]; 2] = [[0, 1, 2], [3, 2, 1]];

/// Runs `test` on a device with ray queries; where there is none, says so.
fn on_device_with_ray_queries(test: impl FnOnce(&Arc<Device>)) {
    let instance = Instance::new(Validation::On).unwrap();
    let device = match Device::open_for(&instance, None, 1, None, RayTracing::RayQuery) {
        Ok(device) => device,
        Err(GpuError::Unsupported { missing, .. }) => return println!("skipped: the device lacks {missing}"),
        Err(error) => panic!("{error}"),
    };
    assert!(device.has_ray_queries());
    test(&device);
    assert_eq!(Arc::strong_count(&device), 1, "the test keeps something of the device");
    drop(device);
    assert_eq!(instance.validation_messages(), Vec::<String>::new());
}

fn at(x: f32, y: f32) -> [[f32; 4]; 3] {
    [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, 0.0]]
}

fn pipeline(device: &Arc<Device>) -> Arc<ComputePipeline> {
    const TABLE: &[Binding] = &[
        row(0, "structure", BindingKind::AccelerationStructure, true, false),
        row(1, "Rays", BindingKind::StorageBuffer, true, false),
        row(2, "Hits", BindingKind::StorageBuffer, false, true),
    ];
    ComputePipeline::new(device, shader("query.comp", TABLE, 0), &[]).unwrap()
}

fn bind(pipeline: &Arc<ComputePipeline>, top: &Arc<TopLevel>, rays: &Arc<Buffer>, hits: &Arc<Buffer>) -> Arc<Bindings> {
    let resources =
        [("structure", Resource::Structure(top)), ("Rays", Resource::Buffer(rays)), ("Hits", Resource::Buffer(hits))];
    Bindings::new(pipeline, &resources).unwrap()
}

#[test]
fn rays_meet_what_was_built_where_it_was_placed() {
    on_device_with_ray_queries(|device| {
        let pipeline = pipeline(device);
        // (x, z, mask): both triangles at x = 0, the second place at x = 5, a mask that passes it, and one beside all.
        let rays = [[-0.5, -0.5, 255.0], [0.5, 0.5, 255.0], [5.5, 0.5, 2.0], [5.5, 0.5, 1.0], [20.0, 0.0, 255.0]];
        let words: Vec<u32> = rays.iter().flat_map(|&[x, z, mask]| [x, z, mask, 0.0f32].map(f32::to_bits)).collect();
        let rays = storage(device, "rays", &words);
        let hits = storage(device, "hits", &[0; 20]);
        let answers = |top: &Arc<TopLevel>| {
            let bindings = bind(&pipeline, top, &rays, &hits);
            run(device, |recorder| recorder.dispatch(&pipeline, &bindings, &[], [1, 1, 1]).unwrap());
            let floats: Vec<f32> = words_of(device, &hits).into_iter().map(f32::from_bits).collect();
            floats.chunks_exact(4).map(|hit| [hit[0], hit[1], hit[2], hit[3]]).collect::<Vec<_>>()
        };

        // Both levels in one recording, then another top level over the same bottom, as when something has moved.
        let mut bottom = None;
        let mut top = None;
        run(device, |recorder| {
            let built = recorder.build_bottom_level("square", &CORNERS, &TRIANGLES).unwrap();
            let placed =
                |x, y, number, mask| Placed { bottom: &built, world_from_object: at(x, y), number, mask, opaque: true };
            top = Some(recorder.build_top_level("two", &[placed(0.0, 0.0, 7, 1), placed(5.0, 2.0, 9, 2)]).unwrap());
            bottom = Some(built);
        });
        let miss = [-1.0, -1.0, -1.0, 0.0];
        let hit = |t, number, triangle| [t, number, triangle, 0.0];
        let (bottom, top) = (bottom.unwrap(), top.unwrap());
        assert!(bottom.bytes() > 0 && top.bytes() > 0);
        assert_eq!(answers(&top), [hit(10.0, 7.0, 0.0), hit(10.0, 7.0, 1.0), hit(8.0, 9.0, 1.0), miss, miss]);
        drop(top);

        // What is not opaque is for the shader to judge, which here takes none of it.
        let mut moved = None;
        run(device, |recorder| {
            let above = Placed { bottom: &bottom, world_from_object: at(0.0, 3.0), number: 1, mask: 1, opaque: false };
            let below = Placed { world_from_object: at(0.0, 1.0), number: 2, opaque: true, ..above };
            moved = Some(recorder.build_top_level("moved", &[above, below]).unwrap());
        });
        // The top level keeps what stands in it.
        drop(bottom);
        let answers = answers(&moved.unwrap());
        assert_eq!(answers[0], [9.0, 2.0, 0.0, 1.0]);
        assert_eq!(answers[2..], [miss, miss, miss]);
    });
}

#[test]
fn nothing_placed_is_nothing_met() {
    on_device_with_ray_queries(|device| {
        let pipeline = pipeline(device);
        let rays = storage(device, "rays", &[0, 0, 255f32.to_bits(), 0]);
        let hits = storage(device, "hits", &[0; 4]);
        run(device, |recorder| {
            let top = recorder.build_top_level("nothing", &[]).unwrap();
            let bindings = bind(&pipeline, &top, &rays, &hits);
            recorder.dispatch(&pipeline, &bindings, &[], [1, 1, 1]).unwrap();
        });
        assert_eq!(f32::from_bits(words_of(device, &hits)[0]), -1.0);
    });
}

#[test]
fn structures_that_cannot_be_are_refused() {
    on_device_with_ray_queries(|device| {
        let mut recorder = Recorder::new(device, 0, "refused").unwrap();
        for (corners, triangles) in [(&CORNERS[..3], &TRIANGLES[..]), (&CORNERS, &[]), (&[], &TRIANGLES)] {
            let refused = recorder.build_bottom_level("broken", corners, triangles);
            assert!(matches!(refused, Err(GpuError::Misuse { .. })), "{refused:?}");
        }
        let bottom = recorder.build_bottom_level("square", &CORNERS, &TRIANGLES).unwrap();
        let placed =
            Placed { bottom: &bottom, world_from_object: at(0.0, 0.0), number: 1 << 24, mask: 1, opaque: true };
        assert!(matches!(recorder.build_top_level("number", &[placed]), Err(GpuError::Misuse { .. })));
        let top = recorder.build_top_level("dropped", &[Placed { number: 0, ..placed }]).unwrap();

        // What was recorded and dropped was never built, so nothing may walk it or be built over it.
        drop(recorder);
        let mut recorder = Recorder::new(device, 0, "too late").unwrap();
        let refused = recorder.build_top_level("over it", &[Placed { number: 0, ..placed }]);
        assert!(matches!(refused, Err(GpuError::Unwritten { .. })), "{refused:?}");
        let pipeline = pipeline(device);
        let (rays, hits) = (storage(device, "rays", &[0; 4]), storage(device, "hits", &[0; 4]));
        let bindings = bind(&pipeline, &top, &rays, &hits);
        let refused = recorder.dispatch(&pipeline, &bindings, &[], [1, 1, 1]);
        assert!(matches!(refused, Err(GpuError::Unwritten { .. })), "{refused:?}");
    });
}

#[test]
fn a_device_that_was_opened_without_refuses_them() {
    on_device(1, |device| {
        assert!(!device.has_ray_queries());
        let mut recorder = Recorder::new(device, 0, "without").unwrap();
        let refused = recorder.build_bottom_level("square", &CORNERS, &TRIANGLES).unwrap_err();
        assert!(matches!(refused, GpuError::Unsupported { .. }), "{refused}");
        let refused = recorder.build_top_level("nothing", &[]).unwrap_err();
        assert!(matches!(refused, GpuError::Unsupported { .. }), "{refused}");
        for kind in [BufferKind::Structure, BufferKind::StructureInput, BufferKind::StructureScratch] {
            let refused = Buffer::new(device, "for structures", kind, 256).unwrap_err();
            assert!(matches!(refused, GpuError::Unsupported { .. }), "{refused}");
        }
    });
}
