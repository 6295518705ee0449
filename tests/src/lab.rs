//! A small room to try the daemon in, and measures of whether anything in it has changed.

use anyhow::Result;
use glam::{DVec3, UVec2};
use lantern_proto::Layer;
use serde_json::{Value, json};

use crate::{client::Client, stage::Stand};

/// Columns and rows of the room's projectors.
pub const SIZE_PX: UVec2 = UVec2::new(96, 64);

/// The room's scene: a white floor and a white ball on it, both diffuse, under a sky of one colour and a lamp.
pub const SCENE: &str = r##"
[scene]
environment = "#406080"
[[scene.node]]
name = "floor"
uri = "lantern:quad"
scale = [3, 1, 3]
[[scene.node]]
name = "ball"
uri = "lantern:sphere"
translation_m = [0, 0.4, 0]
scale = [0.4, 0.4, 0.4]
[[scene.light]]
name = "lamp"
kind = "point"
position_m = [1, 3, 1]
intensity = 8.0
"##;

/// Its bodies, a viewer and one that drives nothing, and their tracker, at a port that `status` tells.
pub const TRACKED: &str = r#"
[[body]]
name = "head"
drives = "viewer"
position_m = [0.5, 1.6, 2.5]
[[body]]
name = "hand"
[[tracker]]
name = "optitrack"
protocol = "lantern"
listen = "127.0.0.1:0"
bodies = { "1" = "head", "2" = "hand" }
"#;

/// How its frames are made: as cheaply as can be.
pub const RENDER: &str = "[render]\nsamples = 1\n";

/// A projector that looks down on the room from one side.
pub fn stand(x: f64) -> Stand {
    Stand::new(DVec3::new(x, 2.0, 3.0), DVec3::new(0.0, 0.3, 0.0), SIZE_PX)
}

/// The room's two projectors, `left` and `right`.
pub fn projectors() -> String {
    stand(-1.0).toml("left") + &stand(1.0).toml("right")
}

/// The room's whole configuration.
pub fn room() -> String {
    room_with("")
}

/// The same after some tables of one's own, such as `[daemon]`.
pub fn room_with(tables: &str) -> String {
    [tables, RENDER, SCENE, TRACKED, &projectors()].join("\n")
}

/// The edit that makes a mirror of the ball.
pub fn mirror() -> Value {
    json!({"material": {"name": "ball/sphere", "base_color": [1, 1, 1], "metallic": 1, "roughness": 0}})
}

/// The file of every layer of a projector: what is shown has not changed where these are the same to the bit.
///
/// # Errors
/// As [`Client::snapshot`].
pub fn everything(client: &mut Client, projector: &str) -> Result<Vec<Vec<u8>>> {
    Layer::ALL.iter().map(|layer| client.snapshot(projector, layer.as_str()).map(|(_, file)| file)).collect()
}
