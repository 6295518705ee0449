//! `[scene]` and its lists.

use crate::reader::{Table, Value};
use crate::scene::{Environment, LightKind, Role, Scene, SceneLight, SceneMaterial, SceneNode};
use std::collections::HashSet;
use std::f64::consts::FRAC_PI_2;

use super::unique_name;

const ROLES: [(&str, Role); 4] =
    [("prop", Role::Prop), ("virtual", Role::Virtual), ("raster", Role::Raster), ("mask", Role::Mask)];

const LIGHT_KINDS: [(&str, LightKind); 3] =
    [("directional", LightKind::Directional), ("point", LightKind::Point), ("spot", LightKind::Spot)];

/// How far a written quaternion's norm may be from 1; people write three digits.
const NORM_TOLERANCE: f64 = 0.01;

pub(crate) fn scene(table: Table<'_>) -> Scene {
    table.note_places("scene");
    let (mut nodes, mut materials, mut lights) = (HashSet::new(), HashSet::new(), HashSet::new());
    let scene = Scene {
        environment: table.get("environment").and_then(|value| environment(&value)),
        nodes: table.tables("node").into_iter().filter_map(|t| node(t, &mut nodes)).collect(),
        materials: table.tables("material").into_iter().filter_map(|t| material(t, &mut materials)).collect(),
        lights: table.tables("light").into_iter().filter_map(|t| light(t, &mut lights)).collect(),
    };
    table.finish();
    scene
}

fn environment(value: &Value<'_>) -> Option<Environment> {
    let text = value.string()?;
    if let Some(digits) = text.strip_prefix('#') {
        if digits.len() == 6 && digits.bytes().all(|b| b.is_ascii_hexdigit()) {
            return Some(Environment::Color(text));
        }
        value.problem(format!("`{text}` is no colour"), "write # and six hexadecimal digits, such as \"#203040\"");
        return None;
    }
    let extension = text.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    if !text.starts_with("lantern:") && !["hdr", "exr", "png"].contains(&extension.as_str()) {
        let hint = "name an equirectangular .hdr, .exr or .png, a colour \"#rrggbb\", or \"lantern:studio\"";
        value.problem(format!("`{text}` is no environment"), hint);
        return None;
    }
    Some(Environment::Uri(text))
}

fn node(table: Table<'_>, taken: &mut HashSet<String>) -> Option<SceneNode> {
    let name = unique_name(&table, "scene.node", taken, "\"car\"");
    if let Some(value) = table.get("name").filter(|_| name.as_ref().is_some_and(|name| name.contains('/'))) {
        let hint = "leave it out: it parts a node's name from those of its materials and lights";
        value.problem("a node's name holds a `/`", hint);
    }
    let uri = table.required("uri", "\"car.glb\"").and_then(|value| value.name());
    let role = table.get("role").and_then(|value| value.choice(&ROLES));
    let translation_m = table.get("translation_m").and_then(|value| value.numbers());
    let rotation = table.get("rotation").and_then(|value| rotation(&value));
    let scale = table.get("scale").and_then(|value| value.numbers_where("that is not 0", |x| x != 0.0));
    table.finish();
    Some(SceneNode { name: name?, uri: uri?, role, translation_m, rotation, scale })
}

/// A quaternion, normalised.
fn rotation(value: &Value<'_>) -> Option<[f64; 4]> {
    let written: [f64; 4] = value.numbers()?;
    let norm = written.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        let hint = "a rotation is a quaternion x, y, z, w of norm 1; none is [0, 0, 0, 1]";
        value.problem(format!("`{}` has norm {norm:.4}", value.path), hint);
        return None;
    }
    Some(written.map(|x| x / norm))
}

fn unit(table: &Table<'_>, key: &'static str) -> Option<f64> {
    table.get(key)?.number_where("from 0 to 1", |x| (0.0..=1.0).contains(&x))
}

fn positive_rgb(table: &Table<'_>, key: &'static str) -> Option<[f64; 3]> {
    table.get(key)?.numbers_where("of at least 0", |x| x >= 0.0)
}

fn material(table: Table<'_>, taken: &mut HashSet<String>) -> Option<SceneMaterial> {
    let name = unique_name(&table, "scene.material", taken, "\"mirror\"");
    let material = SceneMaterial {
        name: name.clone().unwrap_or_default(),
        base_color: table.get("base_color").and_then(|value| base_color(&value)),
        metallic: unit(&table, "metallic"),
        roughness: unit(&table, "roughness"),
        emissive: positive_rgb(&table, "emissive"),
        transmission: unit(&table, "transmission"),
        thickness: table.get("thickness").and_then(|v| v.number_where("of at least 0", |x| x >= 0.0)),
        ior: table.get("ior").and_then(|v| v.number_where("of at least 1", |x| x >= 1.0)),
        clearcoat: unit(&table, "clearcoat"),
        clearcoat_roughness: unit(&table, "clearcoat_roughness"),
    };
    table.finish();
    name.map(|_| material)
}

/// Three or four channels; alpha is 1 where it is not written.
fn base_color(value: &Value<'_>) -> Option<[f64; 4]> {
    let in_range = |x: f64| (0.0..=1.0).contains(&x);
    if value.array("3 or 4 numbers")?.len() == 4 {
        return value.numbers_where("from 0 to 1", in_range);
    }
    let [r, g, b] = value.numbers_where("from 0 to 1", in_range)?;
    Some([r, g, b, 1.0])
}

fn light(table: Table<'_>, taken: &mut HashSet<String>) -> Option<SceneLight> {
    let name = unique_name(&table, "scene.light", taken, "\"sun\"");
    let kind_value = table.required("kind", "\"directional\"");
    let kind = kind_value.and_then(|value| value.choice(&LIGHT_KINDS));

    // What a kind cannot do without is required of it; the rest is read all the same, since the edit takes it too.
    let needs_position = matches!(kind, Some(LightKind::Point | LightKind::Spot));
    let needs_direction = matches!(kind, Some(LightKind::Directional | LightKind::Spot));
    let field = |needed: bool, key, example| if needed { table.required(key, example) } else { table.get(key) };
    let position_m = field(needs_position, "position_m", "[0, 2, 1]").and_then(|value| value.numbers::<3>());
    let direction = field(needs_direction, "direction", "[0, -1, 0]").and_then(|value| {
        let direction: [f64; 3] = value.numbers()?;
        if direction == [0.0; 3] {
            value.problem(format!("`{}` is zero", value.path), "write the way that the light travels");
            return None;
        }
        Some(direction)
    });
    let color = positive_rgb(&table, "color");
    let intensity = table.get("intensity").and_then(|v| v.number_where("of at least 0", |x| x >= 0.0));
    let outer_cone = table.get("outer_cone_rad");
    let outer_cone_rad =
        outer_cone.and_then(|v| v.number_where("above 0 and at most π/2", |x| x > 0.0 && x <= FRAC_PI_2));
    // As in KHR_lights_punctual, whose default for the outer cone is π/4.
    let outer = outer_cone_rad.unwrap_or(std::f64::consts::FRAC_PI_4);
    let inner_cone_rad = table
        .get("inner_cone_rad")
        .and_then(|v| v.number_where(&format!("from 0 to less than {outer:.4}"), |x| (0.0..outer).contains(&x)));
    table.finish();
    Some(SceneLight {
        name: name?,
        kind: kind?,
        position_m,
        direction,
        color,
        intensity,
        inner_cone_rad,
        outer_cone_rad,
    })
}
