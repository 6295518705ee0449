//! A picture in the images of screens: the very bytes with eight bits a channel, the light behind them with ten, and HDR10 as its
//! standards define it; and nothing on a screen of another size.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::sync::Arc;

use glam::{DMat3, DVec3, UVec2};
use lantern_gpu::{Buffer, BufferKind, Image, ImageFormat, ImageUsage, Pixels, Recorder};
use lantern_render::{Layer, Pattern, Target, Texels};
use lantern_tests::gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent, device};
use lantern_tests::stage::{Stand, scene_of};
use serde_json::json;

const SIZE_PX: UVec2 = UVec2::new(96, 60);
const WHITE_NITS: f32 = 400.0;

fn rig() -> Rig {
    let scene = scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:checker"}},
        {"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [0, 0.5, 0], "scale": [0.5, 0.5, 0.5]}},
        {"material": {"name": "ball/sphere", "metallic": 1, "roughness": 0}},
        {"environment": {"uri": "lantern:studio"}},
    ]));
    let stand = Stand::new(DVec3::new(-0.4, 1.6, 3.2), DVec3::new(0.0, 0.5, 0.0), SIZE_PX);
    Rig::shown(&scene, &[("left", stand.calibration())], ONE_SAMPLE, &[DVec3::new(0.8, 1.4, 3.0)])
}

/// The words of an image that the picture was shown in, and whether it was.
fn shown(rig: &mut Rig, size_px: UVec2, format: ImageFormat, pixels: Pixels) -> (Vec<u32>, bool) {
    let usage = ImageUsage::COLOR | ImageUsage::TRANSFER;
    let image = Image::new(device(), "screen", size_px.x, size_px.y, format, usage).unwrap();
    let back = Buffer::new(device(), "back", BufferKind::Readback, image.bytes()).unwrap();
    let mut recorder = Recorder::new(device(), 0, "present").unwrap();
    let target = Target { image: &image, pixels, white_nits: WHITE_NITS };
    let lit = rig.renderer.present(&mut recorder, 0, &target).unwrap();
    recorder.copy_image_to_buffer(&image, &back).unwrap();
    let submission = device().submit(recorder.finish().unwrap(), &[]).unwrap();
    submission.wait(device().hung_after()).unwrap();
    let bytes = back.read(0, image.bytes()).unwrap();
    (bytes.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect(), lit)
}

/// The picture's bytes, red first.
fn picture(rig: &Rig) -> Vec<[u8; 3]> {
    match rig.renderer.read(0, Layer::Color).unwrap().texels {
        Texels::Rgb8(pixels) => pixels,
        other => unreachable!("{other:?}"),
    }
}

/// Three channels of ten bits, the lowest first.
fn tens(word: u32) -> [f64; 3] {
    [0, 10, 20].map(|shift| f64::from(word >> shift & 1023))
}

/// Linear light as it leaves: radiance times weight, no more than white.
fn light(rig: &Rig) -> Vec<DVec3> {
    let (radiance, weight) = (rig.layer(0, Layer::Radiance), rig.layer(0, Layer::Weight));
    let of = |(rgb, weight): (&[f32], &f32)| DVec3::from_slice(&[0, 1, 2].map(|i| f64::from(rgb[i] * weight)));
    radiance
        .values
        .chunks_exact(3)
        .zip(&weight.values)
        .map(of)
        .map(|sent| sent.clamp(DVec3::ZERO, DVec3::ONE))
        .collect()
}

#[test]
fn with_eight_bits_the_screen_shows_the_pictures_own_bytes() {
    let mut rig = rig();
    let expected = picture(&rig);
    assert!(expected.iter().any(|p| *p != expected[0]));
    let (words, lit) = shown(&mut rig, SIZE_PX, ImageFormat::Rgba8Unorm, Pixels::Bits8);
    assert!(lit && words.iter().zip(&expected).all(|(word, [r, g, b])| word.to_le_bytes() == [*r, *g, *b, 255]));
    let (words, lit) = shown(&mut rig, SIZE_PX, ImageFormat::Bgra8Unorm, Pixels::Bits8);
    assert!(lit && words.iter().zip(&expected).all(|(word, [r, g, b])| word.to_le_bytes() == [*b, *g, *r, 255]));
    assert_validation_is_silent();
}

#[test]
fn with_ten_bits_it_shows_the_light_behind_them() {
    let mut rig = rig();
    let encode = |c: f64| if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    let (words, lit) = shown(&mut rig, SIZE_PX, ImageFormat::Rgb10a2Unorm, Pixels::Bits10);
    assert!(lit);
    let mut between = 0;
    for ((word, light), eight) in words.iter().zip(light(&rig)).zip(picture(&rig)) {
        for ((ten, linear), eight) in tens(*word).into_iter().zip(light.to_array()).zip(eight) {
            // Lavapipe cuts ten bits off and does not round; and f32's part of the power.
            assert!((ten - encode(linear) * 1023.0).abs() < 1.02, "{ten} for {linear}");
            between += u32::from((ten / 1023.0 * 255.0 - f64::from(eight)).abs() > 0.2);
        }
    }
    assert!(between > 1000, "only {between} channels lie between the steps of eight bits");

    // A test pattern is black and white, whatever lies behind it.
    rig.renderer.set_pattern(0, Pattern::White).unwrap();
    rig.show(&[DVec3::new(0.8, 1.4, 3.0)]);
    let (words, _) = shown(&mut rig, SIZE_PX, ImageFormat::Bgr10a2Unorm, Pixels::Bits10);
    assert!(words.iter().all(|word| tens(*word) == [1023.0; 3]));
    assert_validation_is_silent();
}

#[test]
fn a_frame_begins_while_the_last_one_is_being_shown() {
    let mut rig = rig();
    // Whatever each kind of screen reads must be free for the next frame.
    let kinds = [
        (ImageFormat::Rgba8Unorm, Pixels::Bits8),
        (ImageFormat::Rgb10a2Unorm, Pixels::Bits10),
        (ImageFormat::Rgb10a2Unorm, Pixels::Hdr10),
    ];
    let mut eye = DVec3::new(0.8, 1.4, 3.0);
    let mut began_early = 0;
    for (format, pixels) in kinds {
        let image = Image::new(device(), "screen", SIZE_PX.x, SIZE_PX.y, format, ImageUsage::COLOR).unwrap();
        let target = Target { image: &image, pixels, white_nits: WHITE_NITS };
        for turn in 0..4 {
            // Stands for a device that takes its time to show, or waits for the screen.
            let mut recorder = Recorder::new(device(), 0, "present").unwrap();
            for _ in 0..100 {
                assert!(rig.renderer.present(&mut recorder, 0, &target).unwrap());
            }
            let showing = device().submit(recorder.finish().unwrap(), &[]).unwrap();
            began_early += u32::from(!showing.is_done().unwrap());
            eye.x += 0.01;
            let rendered = rig.renderer.render(|| vec![eye]).map(drop);
            assert!(rendered.is_ok(), "{pixels:?}, turn {turn}: {}", rendered.unwrap_err());
        }
    }
    assert!(began_early > 0, "no frame began while another was being shown");
    assert_validation_is_silent();
}

#[test]
fn hdr10_is_bt_2020_through_the_perceptual_quantiser() {
    let mut rig = rig();
    // From the chromaticities of both standards (ITU-R BT.709-6 and BT.2020-2), not from the matrix that the shader has.
    let xyz_from = |primaries: [[f64; 2]; 3]| {
        let xyz = |[x, y]: [f64; 2]| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
        let columns = DMat3::from_cols(xyz(primaries[0]), xyz(primaries[1]), xyz(primaries[2]));
        columns * DMat3::from_diagonal(columns.inverse() * xyz([0.3127, 0.3290]))
    };
    let bt709 = xyz_from([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]]);
    let bt2020 = xyz_from([[0.708, 0.292], [0.170, 0.797], [0.131, 0.046]]);
    let bt2020_from_bt709 = bt2020.inverse() * bt709;
    // SMPTE ST 2084, equations 5.1 and 5.2, with its constants as fractions.
    let (m1, m2) = (2610.0 / 16384.0, 2523.0 / 4096.0 * 128.0);
    let (c1, c2, c3) = (3424.0 / 4096.0, 2413.0 / 4096.0 * 32.0, 2392.0 / 4096.0 * 32.0);
    let encode = |nits: f64| {
        let y = (nits.max(0.0) / 10_000.0).powf(m1);
        ((c1 + c2 * y) / (1.0 + c3 * y)).powf(m2)
    };
    let (words, lit) = shown(&mut rig, SIZE_PX, ImageFormat::Rgb10a2Unorm, Pixels::Hdr10);
    assert!(lit);
    let mut brightest = 0.0f64;
    for (word, light) in words.iter().zip(light(&rig)) {
        let nits = bt2020_from_bt709 * light * f64::from(WHITE_NITS);
        for (ten, nits) in tens(*word).into_iter().zip(nits.to_array()) {
            // The shader's matrix has four digits, which near black is a step or two.
            assert!((ten - encode(nits) * 1023.0).abs() < 2.5, "{ten} for {nits} cd/m², not {}", encode(nits) * 1023.0);
            brightest = brightest.max(ten);
        }
    }
    // White, at 400 of 10,000 cd/m².
    assert!((brightest - encode(f64::from(WHITE_NITS)) * 1023.0).abs() < 2.0, "{brightest}");
    assert_validation_is_silent();
}

#[test]
fn a_screen_of_another_size_stays_dark() {
    let mut rig = rig();
    for size_px in [SIZE_PX + UVec2::X, SIZE_PX - UVec2::Y, SIZE_PX * 2] {
        let (words, lit) = shown(&mut rig, size_px, ImageFormat::Rgba8Unorm, Pixels::Bits8);
        assert!(!lit && words.iter().all(|word| word.to_le_bytes() == [0, 0, 0, 255]));
    }
    // And one before there is any picture.
    let (scene, stand) = (rig.renderer.scene().clone(), Stand::new(DVec3::Z, DVec3::ZERO, SIZE_PX));
    let mut unshown = Rig::new(&Arc::clone(&scene), &[("left", stand.calibration())], ONE_SAMPLE);
    let (words, lit) = shown(&mut unshown, SIZE_PX, ImageFormat::Rgba8Unorm, Pixels::Bits8);
    assert!(!lit && words.iter().all(|word| word.to_le_bytes() == [0, 0, 0, 255]));
    assert_validation_is_silent();
}
