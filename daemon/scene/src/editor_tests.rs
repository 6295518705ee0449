//! Sequences of edits, and what must hold after each.

use std::sync::Arc;

use glam::{DQuat, DVec3, Vec3};
use lantern_proto as proto;
use proptest::prelude::*;
use serde_json::json;

use crate::gltf::sample::Sample;
use crate::pack::{NO_TEXTURE, ROLE_PROP};
use crate::{Changes, Edit, Editor, Limits, Moved, Place, Role, Scene, changes, moved};

/// An asset root with the sample as a.glb, and an editor that may read it.
pub(crate) fn studio() -> (tempfile::TempDir, Editor) {
    let folder = tempfile::tempdir().unwrap();
    Sample::new().write(&folder);
    let editor = Editor::new(Limits::default(), vec![folder.path().to_owned()]);
    (folder, editor)
}

pub(crate) fn edits(json: serde_json::Value) -> Vec<Edit> {
    serde_json::from_value(json).unwrap()
}

/// The sample as a node of a configuration.
pub(crate) fn model() -> lantern_config::SceneNode {
    lantern_config::SceneNode {
        name: "model".into(),
        uri: "a.glb".into(),
        role: None,
        translation_m: None,
        rotation: None,
        scale: None,
    }
}

/// What must hold of every revision.
pub(crate) fn verify_invariants(scene: &Scene) {
    assert_eq!(scene.instances.len(), scene.top.instances.len());
    assert_eq!(scene.materials.len(), scene.gpu_materials.len());
    assert_eq!(scene.materials.len(), scene.nodes.iter().map(|node| node.material_names().count()).sum::<usize>());
    for (index, node) in scene.nodes.iter().enumerate() {
        assert_eq!(scene.node(&node.name).unwrap().0, index, "names are unique");
        assert!((node.rotation.length() - 1.0).abs() < 1e-9);
    }
    for (instance, gpu) in scene.instances.iter().zip(&scene.top.instances) {
        let mesh = &scene.meshes[instance.mesh];
        assert_eq!(gpu.scene_node as usize, instance.node);
        assert_eq!(gpu.triangle_count as usize, mesh.indices.len());
        assert_eq!(gpu.material_base, instance.material_base);
        let most = mesh.used_materials.last().map_or(0, |m| m + instance.material_base);
        assert!((most as usize) < scene.materials.len().max(1));
        let opaque =
            mesh.used_materials.iter().all(|m| scene.materials[(m + instance.material_base) as usize].is_opaque());
        assert_eq!(gpu.flags & crate::pack::INSTANCE_OPAQUE != 0, opaque);
        // Where meshes lie is not the scene's to say.
        assert_eq!((gpu.node_base, gpu.triangle_base, gpu.vertex_base), (0, 0, 0));
        let there = Vec3::new(0.3, 0.1, -0.2);
        let world = instance.world_from_object.transform_point3(there.as_dvec3()) - scene.origin_m;
        let rows = gpu.world_from_object.map(|row| Vec3::from_slice(&row[..3]).dot(there) + row[3]);
        assert!((Vec3::from(rows).as_dvec3() - world).length() <= 1e-6 * (1.0 + world.length()));
    }
    for material in scene.gpu_materials.iter() {
        for texture in [material.base_color_texture, material.normal_texture] {
            assert!(texture == NO_TEXTURE || (texture as usize) < scene.textures.headers.len());
        }
    }
    // Every traced instance is in the structure once, nothing else is.
    let mut order = scene.top.order.clone();
    order.sort_unstable();
    let traced =
        scene.instances.iter().enumerate().filter(|(_, i)| i.is_traced() && !scene.meshes[i.mesh].indices.is_empty());
    assert_eq!(order, traced.map(|(index, _)| index as u32).collect::<Vec<_>>());
    assert_eq!(scene.top.nodes.is_empty(), order.is_empty());
    assert!(scene.device_bytes() > 0);
}

/// Compares all that is not a count of revisions or an address.
pub(crate) fn assert_same(a: &Scene, b: &Scene) {
    let nodes = |scene: &Scene| {
        let nodes = scene.nodes.iter();
        nodes
            .map(|n| (n.name.clone(), n.uri.clone(), n.role, n.visible, n.translation_m, n.rotation, n.scale))
            .collect::<Vec<_>>()
    };
    assert_eq!(nodes(a), nodes(b));
    assert_eq!(a.instances, b.instances);
    assert_eq!(a.materials, b.materials);
    assert_eq!(a.meshes.len(), b.meshes.len());
    assert!(a.meshes.iter().zip(&b.meshes).all(|(a, b)| a == b));
    assert_eq!(a.top.instances, b.top.instances);
    assert_eq!(a.top.nodes, b.top.nodes);
    assert_eq!(a.lights, b.lights);
    assert_eq!(a.light_names(), b.light_names());
    assert_eq!(a.textures.headers, b.textures.headers);
    assert_eq!(a.environment.texels, b.environment.texels);
    assert_eq!(a.edits(), b.edits());
}

#[test]
fn an_apply_whose_last_edit_is_wrong_changes_nothing() {
    let (_folder, mut editor) = studio();
    let before = editor.apply(&edits(json!([{"add": {"node": "ball", "uri": "lantern:sphere"}}]))).unwrap();
    for (bad, code, at) in [
        (json!({"set": {"node": "bal", "visible": false}}), "unknown-node", "edits[1].node"),
        (json!({"remove": {"node": "x"}}), "unknown-node", "edits[1].node"),
        (json!({"add": {"node": "ball", "uri": "lantern:cube"}}), "duplicate-node", "edits[1].node"),
        (json!({"add": {"node": "a/b", "uri": "lantern:cube"}}), "bad-value", "edits[1].node"),
        (json!({"add": {"node": "b", "uri": "lantern:torus"}}), "bad-uri", "edits[1].uri"),
        (json!({"add": {"node": "b", "uri": "missing.glb"}}), "bad-uri", "edits[1].uri"),
        (json!({"add": {"node": "b", "uri": "/etc/passwd"}}), "outside-asset-roots", "edits[1].uri"),
        (json!({"add": {"node": "b", "uri": "lantern:cube", "scale": [0, 1, 1]}}), "bad-transform", "edits[1].scale"),
        (json!({"set": {"node": "ball", "rotation": [0, 0, 0, 2]}}), "bad-transform", "edits[1].rotation"),
        (json!({"set": {"node": "ball", "translation_m": [0, 1e300, 0]}}), "bad-transform", "edits[1].translation_m"),
        (json!({"material": {"name": "spere"}}), "unknown-material", "edits[1].name"),
        (json!({"material": {"name": "ball/spere"}}), "unknown-material", "edits[1].name"),
        (json!({"material": {"name": "sphere", "ior": 0.1}}), "bad-value", "edits[1].ior"),
        (json!({"light": {"name": "sun"}}), "bad-value", "edits[1].kind"),
        (json!({"light": {"name": "sun", "remove": true}}), "unknown-light", "edits[1].name"),
        (json!({"environment": {}}), "bad-value", "edits[1].environment"),
        (json!({"environment": {"uri": "lantern:sea"}}), "bad-uri", "edits[1].uri"),
        (json!({"environment": {"uri": "a.glb"}}), "bad-value", "edits[1].uri"),
        (json!({"vertices": {"node": "bal", "mesh": 0, "positions_m": []}}), "unknown-node", "edits[1].node"),
        (json!({"vertices": {"node": "ball", "mesh": 1, "positions_m": []}}), "unknown-mesh", "edits[1].mesh"),
        (json!({"vertices": {"node": "ball", "mesh": "ball", "positions_m": []}}), "unknown-mesh", "edits[1].mesh"),
        (
            json!({"vertices": {"node": "ball", "mesh": 0, "positions_m": [[0, 0, 0]]}}),
            "bad-value",
            "edits[1].positions_m",
        ),
    ] {
        let list = edits(json!([{"set": {"node": "ball", "translation_m": [1, 2, 3]}}, bad]));
        let error = editor.apply(&list).unwrap_err();
        assert_eq!((error.code, error.at.as_str()), (code, at), "{error}");
        assert!(error.message.contains("hint: ") && !error.message.ends_with('.'), "{error}");
        assert!(Arc::ptr_eq(&editor.current(), &before));
    }
    let unknown = editor.apply(&edits(json!([{"material": {"name": "spere"}}]))).unwrap_err();
    assert!(unknown.message.contains("\"sphere\""), "{unknown}");
}

fn place(editor: &mut Editor, node: &str, translation_m: DVec3, rotation: DQuat) -> Arc<Scene> {
    editor.place_all(&[Place { node, translation_m, rotation }])
}

#[test]
fn moving_a_node_rebuilds_the_top_level_alone() {
    let (_folder, mut editor) = studio();
    let old = editor
        .apply(&edits(json!([
            {"add": {"node": "model", "uri": "a.glb"}},
            {"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [3, 0, 0]}},
            {"environment": {"uri": "lantern:studio"}},
        ])))
        .unwrap();
    let turned = DQuat::from_rotation_y(0.5);
    let new = place(&mut editor, "ball", DVec3::new(3.0, 1.0, 0.0), turned);
    verify_invariants(&new);
    assert_eq!(new.revision, old.revision + 1);
    assert!(Arc::ptr_eq(&old.textures, &new.textures));
    assert!(Arc::ptr_eq(&old.materials, &new.materials) && Arc::ptr_eq(&old.environment, &new.environment));
    assert!(old.meshes.iter().zip(&new.meshes).all(|(old, new)| Arc::ptr_eq(old, new)));
    assert!(!Arc::ptr_eq(&old.top, &new.top) && old.top.nodes != new.top.nodes);
    assert_eq!(changes(&old, &new), Changes { props_moved: true, ..Changes::default() });
    assert_eq!(new.node("ball").unwrap().1.rotation, turned);

    // To where it is already: nothing at all.
    let same = place(&mut editor, "ball", DVec3::new(3.0, 1.0, 0.0), turned);
    assert!(Arc::ptr_eq(&same, &new));
    // Nobody's node, and places where nothing can stand, keep nobody else from moving.
    let nowhere = [("bell", DVec3::ZERO), ("ball", DVec3::splat(f64::NAN)), ("model", DVec3::splat(1e300))];
    for (node, at) in nowhere {
        assert!(Arc::ptr_eq(&place(&mut editor, node, at, DQuat::IDENTITY), &new));
    }
    assert_eq!(editor.place("bell", DVec3::ZERO, DQuat::IDENTITY).unwrap_err().code, "unknown-node");
    let all = nowhere.map(|(node, translation_m)| Place { node, translation_m, rotation: turned });
    let all = [all[0], Place { translation_m: DVec3::Y, ..all[1] }, all[2]];
    let new = editor.place_all(&all);
    verify_invariants(&new);
    assert_eq!((new.nodes[1].translation_m, new.nodes[0].translation_m), (DVec3::Y, DVec3::ZERO));
    // The node with lights takes them along.
    let moved = place(&mut editor, "model", DVec3::X, DQuat::IDENTITY);
    assert!(changes(&new, &moved).lights);
}

#[test]
fn changes_name_what_an_edit_touched() {
    let (_folder, mut editor) = studio();
    let setup = json!([
        {"add": {"node": "prop", "uri": "lantern:cube"}},
        {"add": {"node": "ghost", "uri": "lantern:cube", "role": "virtual"}},
        {"add": {"node": "drawn", "uri": "lantern:cube", "role": "raster"}},
        {"light": {"name": "sun", "kind": "directional"}},
    ]);
    let mut old = editor.apply(&edits(setup)).unwrap();
    let none = Changes::default();
    for (edit, expected) in [
        (json!({"set": {"node": "ghost", "translation_m": [1, 0, 0]}}), Changes { virtual_moved: true, ..none }),
        (json!({"set": {"node": "drawn", "translation_m": [1, 0, 0]}}), Changes { raster_moved: true, ..none }),
        (json!({"set": {"node": "prop", "role": "mask"}}), Changes { props_moved: true, ..none }),
        (
            json!({"set": {"node": "prop", "role": "virtual"}}),
            Changes { props_moved: true, virtual_moved: true, ..none },
        ),
        (json!({"set": {"node": "prop", "visible": false}}), Changes { virtual_moved: true, ..none }),
        (json!({"set": {"node": "prop", "translation_m": [5, 0, 0]}}), none),
        (json!({"material": {"name": "ghost/cube", "roughness": 0.5}}), Changes { materials: true, ..none }),
        (json!({"light": {"name": "sun", "intensity": 2}}), Changes { lights: true, ..none }),
        (json!({"environment": {"color": "#ff8000"}}), Changes { environment: true, ..none }),
        (json!({"environment": {"color": "#ff8000"}}), none),
    ] {
        let new = editor.apply(&edits(json!([edit]))).unwrap();
        assert_eq!(changes(&old, &new), expected, "{edit}");
        verify_invariants(&new);
        old = new;
    }
    let new = editor.apply(&edits(json!([{"add": {"node": "m", "uri": "a.glb"}}]))).unwrap();
    let found = changes(&old, &new);
    assert!(found.textures && found.props_moved && found.materials && found.lights);
}

#[test]
fn what_has_moved_is_where_it_was_and_where_it_is() {
    let (_folder, mut editor) = studio();
    let setup = json!([
        {"add": {"node": "first", "uri": "lantern:cube", "translation_m": [-5, 0, 0]}},
        {"add": {"node": "prop", "uri": "lantern:cube"}},
        {"add": {"node": "ghost", "uri": "lantern:cube", "role": "virtual"}},
        {"add": {"node": "drawn", "uri": "lantern:cube", "role": "raster"}},
    ]);
    let mut old = editor.apply(&edits(setup)).unwrap();
    let cube = |physical: bool, x: f64| {
        let at_m = DVec3::new(x, 0.0, 0.0);
        Moved { physical, low_m: at_m - 0.5, high_m: at_m + 0.5 }
    };
    for (edit, expected) in [
        (json!({"set": {"node": "prop", "translation_m": [2, 0, 0]}}), vec![cube(true, 0.0), cube(true, 2.0)]),
        (json!({"set": {"node": "prop", "role": "mask"}}), vec![cube(true, 2.0), cube(true, 2.0)]),
        (json!({"set": {"node": "prop", "role": "virtual"}}), vec![cube(true, 2.0), cube(false, 2.0)]),
        (json!({"set": {"node": "prop", "visible": false}}), vec![cube(false, 2.0)]),
        (json!({"set": {"node": "ghost", "translation_m": [1, 0, 0]}}), vec![cube(false, 0.0), cube(false, 1.0)]),
        (json!({"set": {"node": "drawn", "translation_m": [1, 0, 0]}}), vec![]),
        (json!({"material": {"name": "ghost/cube", "roughness": 0.5}}), vec![]),
        // What comes at the end renumbers nothing, though the geometry is packed anew.
        (json!({"add": {"node": "last", "uri": "lantern:quad", "role": "raster"}}), vec![]),
        // What goes renumbers all behind it: a hit that was stored as the ghost's is another's now.
        (json!({"remove": {"node": "first"}}), vec![cube(true, -5.0), cube(false, 1.0), cube(false, 1.0)]),
    ] {
        let new = editor.apply(&edits(json!([edit]))).unwrap();
        assert_eq!(moved(&old, &new), expected, "{edit}");
        old = new;
    }
}

#[test]
fn materials_go_by_name_or_by_node_and_name() {
    let mut editor = Editor::new(Limits::default(), vec![]);
    let balls = json!([
        {"add": {"node": "a", "uri": "lantern:sphere"}},
        {"add": {"node": "b", "uri": "lantern:sphere"}},
        {"material": {"name": "sphere", "metallic": 1}},
        {"material": {"name": "b/sphere", "roughness": 0, "base_color": [0.5, 0.5, 0.5]}},
    ]);
    let scene = editor.apply(&edits(balls)).unwrap();
    let gpu = |index: usize| scene.gpu_materials[index];
    assert_eq!((gpu(0).metallic, gpu(0).roughness), (1.0, 1.0));
    assert_eq!((gpu(1).metallic, gpu(1).roughness, gpu(1).base_color), (1.0, 0.0, [0.5, 0.5, 0.5, 1.0]));
    assert_eq!(scene.meshes.len(), 1, "one mesh serves both");
    assert_eq!(scene.instances[1].material_base, 1);
}

#[test]
fn a_role_that_is_said_wins_over_the_files() {
    let (folder, mut editor) = studio();
    let roles = |scene: &Scene| scene.instances.iter().map(|instance| instance.role).collect::<Vec<_>>();
    let add = |role: Option<&str>| json!({"add": {"node": "model", "uri": "a.glb", "role": role}});
    let fresh = |editor: &mut Editor, role| {
        let _ = editor.apply(&edits(json!([{"remove": {"node": "model"}}])));
        editor.apply(&edits(json!([add(role)]))).unwrap()
    };
    // The sample masks its last part.
    let (prop, mask) = (Role::Prop, Role::Mask);
    let scene = fresh(&mut editor, None);
    assert_eq!(
        (roles(&scene), scene.edits()[0].clone()),
        (vec![prop, prop, mask], edits(json!([add(None)])).remove(0))
    );
    for (said, role) in [("prop", prop), ("virtual", Role::Virtual), ("raster", Role::Raster), ("mask", mask)] {
        let scene = fresh(&mut editor, Some(said));
        assert_eq!(roles(&scene), [role; 3]);
        assert_eq!(scene.edits()[..1], edits(json!([add(Some(said))])));
    }

    // A set says it as well, even where it says what would hold for most parts anyway; another set leaves it.
    fresh(&mut editor, None);
    editor.apply(&edits(json!([{"set": {"node": "model", "translation_m": [1, 0, 0]}}]))).unwrap();
    assert_eq!(roles(&editor.current()), [prop, prop, mask]);
    editor.apply(&edits(json!([{"set": {"node": "model", "role": "prop"}}]))).unwrap();
    let scene = editor.apply(&edits(json!([{"set": {"node": "model", "translation_m": [0, 0, 0]}}]))).unwrap();
    assert_eq!((roles(&scene), &scene.edits()[..1]), (vec![prop; 3], &edits(json!([add(Some("prop"))]))[..]));

    // And so does the configuration.
    for (role, expected) in [(None, vec![prop, prop, mask]), (Some(lantern_config::Role::Prop), vec![prop; 3])] {
        let node = lantern_config::SceneNode { role, ..model() };
        let config = lantern_config::Scene { nodes: vec![node], ..Default::default() };
        let editor = Editor::from_config(&config, folder.path(), Limits::default(), vec![]).unwrap();
        assert_eq!(roles(&editor.current()), expected);
    }
}

#[test]
fn scene_get_lists_all_adds_first() {
    let (_folder, mut editor) = studio();
    let scene = editor
        .apply(&edits(json!([
            {"add": {"node": "gone", "uri": "lantern:cube"}},
            {"add": {"node": "model", "uri": "a.glb", "translation_m": [1, 2, 3]}},
            {"set": {"node": "model", "visible": false}},
            {"material": {"name": "model/paint", "roughness": 0.5}},
            {"light": {"name": "model/lamp", "intensity": 7}},
            {"light": {"name": "sun", "kind": "directional", "direction": [0, -1, 0]}},
            {"remove": {"node": "gone"}},
            {"add": {"node": "floor", "uri": "lantern:checker", "role": "prop"}},
        ])))
        .unwrap();
    let expected = edits(json!([
        {"add": {"node": "model", "uri": "a.glb", "translation_m": [1.0, 2.0, 3.0]}},
        {"add": {"node": "floor", "uri": "lantern:checker", "role": "prop"}},
        {"set": {"node": "model", "visible": false}},
        {"material": {"name": "model/paint", "roughness": 0.5}},
        {"light": {"name": "model/lamp", "intensity": 7.0}},
        {"light": {"name": "sun", "kind": "directional", "direction": [0.0, -1.0, 0.0]}},
        {"environment": {"color": [0.0, 0.0, 0.0]}},
    ]));
    assert_eq!(scene.edits(), expected);
}

#[test]
fn far_away_the_world_gets_an_origin_of_its_own() {
    let mut editor = Editor::new(Limits::default(), vec![]);
    let far = json!([
        {"add": {"node": "a", "uri": "lantern:cube", "translation_m": [50_000.25, 0, 0]}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [50_001, 0, 0]}},
    ]);
    let scene = editor.apply(&edits(far)).unwrap();
    verify_invariants(&scene);
    assert_eq!(scene.origin_m, DVec3::new(50_000.0, 0.0, 0.0));
    assert_eq!(scene.top.instances[0].world_from_object[0][3], 0.25);
    assert_eq!(scene.lights[0].position, [1.0, 0.0, 0.0]);
    let hit = scene.cast(DVec3::new(50_000.25, 0.0, 5.0), DVec3::NEG_Z, 0.0, 1e9, ROLE_PROP).unwrap();
    assert!((hit.t - 4.5).abs() < 1e-9);
}

/// Any edit, good or bad, out of small sets of names.
fn any_edit() -> impl Strategy<Value = serde_json::Value> {
    let node = || prop::sample::select(vec!["a", "b", "c"]);
    let uri = prop::sample::select(vec!["lantern:sphere", "lantern:cube", "lantern:checker", "a.glb", "lantern:odd"]);
    let role = || prop::option::of(prop::sample::select(vec!["prop", "virtual", "raster", "mask"]));
    let place = || prop::array::uniform3(-10f64..10.0);
    let material = prop::sample::select(vec!["sphere", "a/cube", "b/paint", "paint", "red", "c/default"]);
    let light = prop::sample::select(vec!["sun", "a/lamp", "b/light 1", "b/light 1 2", "lamp"]);
    let kind = prop::option::of(prop::sample::select(vec!["directional", "point", "spot"]));
    prop_oneof![
        4 => (node(), uri, role(), place(), -1f64..1.0).prop_map(|(node, uri, role, place, s)| {
            let turn = DQuat::from_rotation_x(s).to_array();
            json!({"add": {"node": node, "uri": uri, "role": role, "translation_m": place, "rotation": turn, "scale": [1, s, 2]}})
        }),
        1 => node().prop_map(|node| json!({"remove": {"node": node}})),
        3 => (node(), role(), place(), prop::option::of(any::<bool>())).prop_map(|(node, role, place, visible)| {
            json!({"set": {"node": node, "role": role, "translation_m": place, "visible": visible}})
        }),
        3 => (material, -0.1f64..1.1, prop::option::of(0f64..1.0)).prop_map(|(name, roughness, transmission)| {
            json!({"material": {"name": name, "roughness": roughness, "transmission": transmission}})
        }),
        3 => (light, kind, prop::option::of(place()), any::<Option<u8>>(), 0..4).prop_map(|(name, kind, place, intensity, remove)| {
            json!({"light": {"name": name, "kind": kind, "position_m": place, "intensity": intensity, "remove": remove == 0}})
        }),
        1 => prop_oneof![Just(json!({"uri": "lantern:studio"})), Just(json!({"color": [0.5, 0.25, 0.125]})), Just(json!({}))]
            .prop_map(|environment| json!({"environment": environment})),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// After any sequence the invariants hold, a refused list has changed nothing, and what `scene.get` says rebuilds
    /// the scene.
    #[test]
    fn any_sequence_of_edits_can_be_told_and_rebuilt(
        lists in prop::collection::vec(prop::collection::vec(any_edit(), 1..4), 1..12),
    ) {
        let (folder, mut editor) = studio();
        for list in lists {
            let before = editor.current();
            match editor.apply(&edits(json!(list))) {
                Ok(scene) => {
                    prop_assert_eq!(scene.revision, before.revision + 1);
                    verify_invariants(&scene);
                }
                Err(error) => {
                    prop_assert!(error.at.starts_with("edits["));
                    prop_assert!(Arc::ptr_eq(&editor.current(), &before));
                }
            }
        }
        let scene = editor.current();
        let mut rebuilt = Editor::new(Limits::default(), vec![folder.path().to_owned()]);
        let told = serde_json::to_string(&scene.edits()).unwrap();
        let told: Vec<proto::Edit> = serde_json::from_str(&told).unwrap();
        assert_same(&rebuilt.apply(&told).unwrap(), &scene);
    }
}
