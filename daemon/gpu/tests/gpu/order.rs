//! Submissions: their order, what they keep alive, and what the host may touch meanwhile.

use std::sync::Arc;
use std::time::Duration;

use lantern_gpu::*;

use crate::common::*;

/// Work that takes a while, also for a fast device: a long chain of dispatches over a big buffer.
fn slow(device: &Arc<Device>, queue: usize, back: &Arc<Buffer>) -> Commands {
    let words = 1 << 20;
    let data = Buffer::new(device, "big", BufferKind::Storage, words * 4).unwrap();
    let pipeline = ComputePipeline::new(device, step(), &[]).unwrap();
    let bindings = Bindings::new(&pipeline, &[("Data", Resource::Buffer(&data))]).unwrap();
    let mut recorder = Recorder::new(device, queue, "slow").unwrap();
    recorder.fill(&data, 1).unwrap();
    for _ in 0..100 {
        recorder.dispatch(&pipeline, &bindings, &[], [words as u32 / 64, 1, 1]).unwrap();
    }
    recorder.copy_buffer(&data, 0, back, 0, back.bytes()).unwrap();
    recorder.finish().unwrap()
}

#[test]
fn what_is_in_flight_outlives_its_owners() {
    on_device(1, |device| {
        let back = readback(device, 64);
        let commands = slow(device, 0, &back);
        // Everything but the readback is dropped, the submission too; the work goes on.
        drop(device.submit(commands, &[]).unwrap());
        let at_work = device.allocated_bytes();
        assert!(at_work > 4 << 20, "{at_work} bytes while the work is on");
        device.wait_idle().unwrap();
        let expected: Vec<u32> =
            (0..16).map(|i| (0..100).fold(1u32, |x, _| x.wrapping_mul(3).wrapping_add(i))).collect();
        assert_eq!(words(&back), expected);
        assert!(device.allocated_bytes() < 1 << 20, "completed work was not let go");
    });
}

#[test]
fn a_device_that_is_dropped_first_finishes_its_work() {
    let instance = Instance::new(Validation::On).unwrap();
    let device = Device::open(&instance, None, 1, None).unwrap();
    let back = readback(&device, 64);
    let submission = device.submit(slow(&device, 0, &back), &[]).unwrap();
    drop(device);
    submission.wait(TIMEOUT).unwrap();
    assert_eq!(words(&back)[0], 3u32.wrapping_pow(100));
    drop((submission, back));
    assert_eq!(instance.validation_messages(), Vec::<String>::new());
}

#[test]
fn the_host_keeps_off_what_the_device_uses() {
    on_device(1, |device| {
        let back = readback(device, 64);
        let submission = device.submit(slow(device, 0, &back), &[]).unwrap();
        if !submission.is_done().unwrap() {
            let timeout = submission.wait(Duration::ZERO);
            let (read, written) = (back.read(0, 4), back.write(0, &[0]));
            // A device that was faster than these lines has made them legal.
            if !submission.is_done().unwrap() {
                assert!(matches!(timeout, Err(GpuError::Timeout { .. })));
                assert!(matches!(read, Err(GpuError::InFlight { .. })));
                assert!(matches!(written, Err(GpuError::InFlight { .. })));
            }
        }
        submission.wait(TIMEOUT).unwrap();
        back.write(0, &[1]).unwrap();
        assert_eq!(back.read(0, 1).unwrap(), [1]);
    });
}

#[test]
fn commands_are_submitted_in_the_order_of_their_recording() {
    on_device(1, |device| {
        let buffer = storage(device, "buffer", &[0]);
        let record = |value| {
            let mut recorder = Recorder::new(device, 0, "fill").unwrap();
            recorder.fill(&buffer, value).unwrap();
            recorder.finish().unwrap()
        };
        let (first, second) = (record(1), record(2));
        assert!(matches!(device.submit(second, &[]), Err(GpuError::Order { .. })));
        device.submit(first, &[]).unwrap();
        assert_eq!(words_of(device, &buffer), [1]);

        // In order, both recorded before either is submitted.
        let (first, second) = (record(3), record(4));
        device.submit(first, &[]).unwrap();
        device.submit(second, &[]).unwrap();
        assert_eq!(words_of(device, &buffer), [4]);
    });
}

#[test]
fn what_was_recorded_and_dropped_never_happened() {
    on_device(1, |device| {
        let usage = ImageUsage::STORAGE | ImageUsage::TRANSFER;
        let image = Image::new(device, "canvas", 8, 8, ImageFormat::Rgba32Float, usage).unwrap();
        let paint = ComputePipeline::new(device, paint(), &[]).unwrap();
        let bindings = Bindings::new(&paint, &[("canvas", Resource::Image(&image))]).unwrap();
        let back = readback(device, image.bytes());

        // Before anything was written, a dropped recording leaves the image as unwritten as it was.
        let mut dropped = Recorder::new(device, 0, "dropped").unwrap();
        dropped.dispatch(&paint, &bindings, &[], [1, 1, 1]).unwrap();
        drop(dropped);
        let mut recorder = Recorder::new(device, 0, "early").unwrap();
        assert!(matches!(recorder.copy_image_to_buffer(&image, &back), Err(GpuError::Unwritten { .. })));
        drop(recorder);

        // Afterwards, it leaves the image in the layout and with the contents that it had.
        run(device, |recorder| recorder.dispatch(&paint, &bindings, &[], [1, 1, 1]).unwrap());
        let mut dropped = Recorder::new(device, 0, "dropped").unwrap();
        dropped.copy_image_to_buffer(&image, &back).unwrap();
        drop(dropped.finish().unwrap());
        run(device, |recorder| recorder.copy_image_to_buffer(&image, &back).unwrap());
        assert_eq!(floats(&back)[(8 * 3 + 5) * 4 + 2], 503.0);
    });
}

#[test]
fn projectors_get_queues_of_their_own_or_share_them() {
    on_device(5, |device| {
        let count = device.queue_count();
        assert!((1..=5).contains(&count));
        for i in 0..5 {
            let queue = device.queue(i);
            assert_eq!(queue.index as usize, i % count);
        }
    });
}

#[test]
fn queues_wait_for_each_other_on_the_device() {
    on_device(3, |device| {
        let buffer = storage(device, "buffer", &[1; 64]);
        let pipeline = ComputePipeline::new(device, step(), &[]).unwrap();
        let bindings = Bindings::new(&pipeline, &[("Data", Resource::Buffer(&buffer))]).unwrap();
        let mut last = None;
        for turn in 0..30 {
            let mut recorder = Recorder::new(device, turn % 3, "turn").unwrap();
            recorder.dispatch(&pipeline, &bindings, &[], [1, 1, 1]).unwrap();
            let waits: Vec<&Submission> = last.iter().collect();
            last = Some(device.submit(recorder.finish().unwrap(), &waits).unwrap());
        }
        last.unwrap().wait(TIMEOUT).unwrap();
        let expected = |i| (0..30).fold(1u32, |x, _| x.wrapping_mul(3).wrapping_add(i));
        assert_eq!(words_of(device, &buffer), (0..64).map(expected).collect::<Vec<_>>());
    });
}

#[test]
fn threads_record_and_submit_side_by_side() {
    on_device(4, |device| {
        std::thread::scope(|scope| {
            for thread in 0..4u32 {
                scope.spawn(move || {
                    let buffer = Buffer::new(device, "own", BufferKind::Storage, 256).unwrap();
                    let back = readback(device, 256);
                    for turn in 0..20 {
                        let mut recorder = Recorder::new(device, thread as usize, "turn").unwrap();
                        recorder.fill(&buffer, thread * 1000 + turn).unwrap();
                        recorder.copy_buffer(&buffer, 0, &back, 0, 256).unwrap();
                        device.submit(recorder.finish().unwrap(), &[]).unwrap().wait(TIMEOUT).unwrap();
                        assert_eq!(words(&back), [thread * 1000 + turn; 64]);
                    }
                });
            }
        });
    });
}
