//! Lenses that bend strongly, for an image of any size.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::{DVec2, UVec2, Vec2};
use lantern_calibration::{BrownConrady, Lens, Warp};

/// A barrel with a decentred axis, which moves the corners by a tenth of the image's width.
pub fn barrel(size_px: UVec2) -> Lens {
    let size = size_px.as_dvec2();
    let (k1, k2, p1, p2, k3) = (-0.26, 0.05, 0.006, -0.009, 0.003);
    let focal_px = DVec2::new(0.72, 0.73) * size.x;
    Lens::BrownConrady(BrownConrady { focal_px, centre_px: size * DVec2::new(0.48, 0.53), k1, k2, p1, p2, k3 })
}

/// The opposite of a barrel, about an axis below the image.
pub fn pincushion(size_px: UVec2) -> Lens {
    let size = size_px.as_dvec2();
    let (k1, k2, p1, p2, k3) = (0.22, 0.04, -0.004, 0.002, 0.0);
    let focal_px = DVec2::new(0.9, 0.9) * size.x;
    Lens::BrownConrady(BrownConrady { focal_px, centre_px: size * DVec2::new(0.51, 1.1), k1, k2, p1, p2, k3 })
}

/// Where a warp of waves, turned by some degrees, looks from a place of the image.
pub fn waves(size_px: UVec2, at_px: DVec2) -> DVec2 {
    let size = size_px.as_dvec2();
    let at = at_px / size - 0.5;
    let turned = DVec2::from_angle(0.07).rotate(at * size) * 0.93;
    let wave = DVec2::new((at.y * TAU * 1.2).sin(), (at.x * TAU * 0.9 + 0.5).cos());
    size * 0.5 + turned + wave * 0.035 * size.x
}

/// That warp, on a grid of so many nodes; `dark` says where no light goes.
pub fn warp(size_px: UVec2, nodes: UVec2, dark: impl Fn(DVec2) -> bool) -> Lens {
    let node = |i: u32| {
        let at_px = (UVec2::new(i % nodes.x, i / nodes.x).as_dvec2() + 0.5) / nodes.as_dvec2() * size_px.as_dvec2();
        if dark(at_px) { Vec2::NAN } else { waves(size_px, at_px).as_vec2() }
    };
    Lens::Warp(Arc::new(Warp { size: nodes, ideal_px: (0..nodes.x * nodes.y).map(node).collect() }))
}

/// One of each kind, with its name.
pub fn all(size_px: UVec2) -> [(&'static str, Lens); 4] {
    let middle_px = size_px.as_dvec2() * 0.5;
    let hole = move |at_px: DVec2| at_px.distance(middle_px) < middle_px.y * 0.15;
    [
        ("barrel", barrel(size_px)),
        ("pincushion", pincushion(size_px)),
        ("coarse warp", warp(size_px, UVec2::new(33, 21), |_| false)),
        ("warp with a hole", warp(size_px, size_px, hole)),
    ]
}
