//! `lanternd demo`: the embedded configuration and scene on two projectors, seen from three places.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;
use glam::DVec3;
use lantern_config::Config;
use lantern_render::{Layer, LayerImage, Renderer};

use super::progress::Progress;
use crate::encode::{self, srgb8};
use crate::service::setup;
use crate::service::vulkan::{open_device, open_vulkan};

/// The demo's configuration.
pub const CONFIG: &str = include_str!("../../../config/demo.toml");

/// Where the three viewers stand, m: to the left, before and to the right of the table.
const EYES: [(&str, DVec3); 3] =
    [("left", DVec3::new(-1.2, 1.5, 1.9)), ("middle", DVec3::new(0.0, 1.6, 2.2)), ("right", DVec3::new(1.2, 1.2, 1.9))];

/// Parses the embedded configuration.
///
/// # Errors
/// Every problem; a test shows that there is none.
pub fn config() -> Result<Config, setup::Problems> {
    Config::parse(CONFIG, "config/demo.toml", Path::new(".")).map_err(setup::Problems)
}

/// Renders, writes PNGs to `out`, and says what was written and how fast `frames` frames with a moving eye are.
///
/// # Errors
/// No Vulkan, or no place to write.
pub fn demo(out: &Path, frames: u32) -> anyhow::Result<()> {
    let start = Instant::now();
    fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    let config = config()?;
    let device = open_device(&open_vulkan()?, &config)?;
    say!("device: {} ({})", device.info().name, device.info().driver_info);

    let progress = Progress::new(3 + EYES.len() as u64 * 4 + u64::from(frames));
    let step = |what: &str| progress.step(what);
    step("scene: tessellating, building structures");
    let loaded = setup::from_config(config, "config/demo.toml")?;
    let settings = setup::settings(&loaded.config);
    step("shaders: compiling");
    let mut renderer = Renderer::new(&device, loaded.projectors, settings, loaded.editor.current())?;

    // One picture a projector and eye, and what the eye sees of the room under both.
    let mut written = Vec::new();
    let mut columns = Vec::new();
    let mut first_picture = None;
    for (eye, at) in EYES {
        step(&format!("eye {eye}: tracing"));
        renderer.render(|| vec![at])?;
        let mut column = Vec::new();
        let names: Vec<String> = renderer.projectors().map(|p| p.name.clone()).collect();
        for (index, name) in names.iter().enumerate() {
            let layer = renderer.read(index, Layer::Color)?;
            let path = out.join(format!("projector-{name}-eye-{eye}.png"));
            write(&path, &encode::encode(&layer)?.bytes)?;
            first_picture.get_or_insert_with(|| start.elapsed());
            step(&format!("wrote {}", path.display()));
            written.push(path);
            column.push(layer);
        }
        let size_px = [column[0].width, column[0].height];
        let room = renderer.room(at, size_px)?;
        let path = out.join(format!("room-eye-{eye}.png"));
        write(&path, &encode::encode_seen(&room)?.bytes)?;
        step(&format!("wrote {}", path.display()));
        written.push(path);
        column.push(room);
        columns.push(column);
    }
    let sheet = out.join("contact-sheet.png");
    write(&sheet, &contact_sheet(&columns)?)?;
    step("contact sheet");
    written.push(sheet);

    // How fast: the eye walks, and nothing else changes.
    let walk = walk(&mut renderer, frames, || step("the eye walks"))?;
    progress.finish();

    say!("wrote:");
    for path in &written {
        say!("  {}", path.display());
    }
    if let Some(first) = first_picture {
        say!("first picture {:.1} s after the start", first.as_secs_f64());
    }
    if frames > 0 {
        say!(
            "{frames} frames with a moving eye: {:.1} ms a frame of {} projectors, {:.2} frames/s",
            walk * 1e3,
            renderer.projectors().len(),
            1.0 / walk
        );
    }
    say!("the room as each eye sees it, and what each projector shows for it: contact-sheet.png");
    Ok(())
}

/// Seconds a frame while the eye walks around the table.
fn walk(renderer: &mut Renderer, frames: u32, step: impl Fn()) -> anyhow::Result<f64> {
    let start = Instant::now();
    for frame in 0..frames {
        let angle = f64::from(frame) / f64::from(frames) * std::f64::consts::TAU;
        let eye = DVec3::new(angle.sin() * 1.5, 1.4, 1.8);
        renderer.render(|| vec![eye])?;
        step();
    }
    Ok(start.elapsed().as_secs_f64() / f64::from(frames.max(1)))
}

fn write(path: &PathBuf, bytes: &[u8]) -> anyhow::Result<()> {
    fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Pictures beside each other at half their size, a column an eye: what the eye sees on top, the projectors below.
fn contact_sheet(columns: &[Vec<LayerImage>]) -> anyhow::Result<Vec<u8>> {
    const GAP: u32 = 12;
    let (width, height) = (columns[0][0].width / 2, columns[0][0].height / 2);
    let rows = columns[0].len() as u32;
    let sheet_px = [columns.len() as u32 * (width + GAP) + GAP, rows * (height + GAP) + GAP];
    let mut sheet = vec![[24_u8; 3]; (sheet_px[0] * sheet_px[1]) as usize];
    for (x, column) in columns.iter().enumerate() {
        let pictures = column.iter().rev().take(1).chain(column.iter().take(column.len() - 1));
        for (y, picture) in pictures.enumerate() {
            let at = [GAP + x as u32 * (width + GAP), GAP + y as u32 * (height + GAP)];
            paste_half(&mut sheet, sheet_px[0], at, picture);
        }
    }
    Ok(encode::png(sheet_px[0], sheet_px[1], &sheet)?.bytes)
}

/// Copies a picture at half its size, by the mean of 2 × 2 texels.
fn paste_half(sheet: &mut [[u8; 3]], sheet_width: u32, at: [u32; 2], picture: &LayerImage) {
    let texels = Arc::<[[u8; 3]]>::from(srgb8(picture));
    for y in 0..picture.height / 2 {
        for x in 0..picture.width / 2 {
            let from = |dx: u32, dy: u32| texels[((2 * y + dy) * picture.width + 2 * x + dx) as usize];
            let quad = [from(0, 0), from(1, 0), from(0, 1), from(1, 1)];
            let mean = |c: usize| (quad.iter().map(|t| u32::from(t[c])).sum::<u32>() / 4) as u8;
            sheet[((at[1] + y) * sheet_width + at[0] + x) as usize] = [mean(0), mean(1), mean(2)];
        }
    }
}
