//! Bad input gets its message, with place and remedy, or is counted; what is shown stays to the bit.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    fs,
    net::UdpSocket,
    path::Path,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use lantern_tests::{
    harness::{self, Daemon},
    lab, models,
};
use serde_json::{Value, json};

/// A good glTF of one triangle, its buffer beside it.
fn triangle() -> Value {
    json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}], "scene": 0,
        "nodes": [{"mesh": 0, "name": "leaf"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": "triangle.bin", "byteLength": 44}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
    })
}

fn triangle_bytes(corner: f32, index: u16) -> Vec<u8> {
    let mut bytes: Vec<u8> =
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, corner, 0.0f32].iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0, 1, index].iter().flat_map(|i| i.to_le_bytes()));
    bytes.extend([0, 0]);
    bytes
}

/// As binary glTF, the buffer inside.
fn glb(mut gltf: Value, bytes: &[u8]) -> Vec<u8> {
    gltf["buffers"][0].as_object_mut().unwrap().remove("uri");
    models::glb(&gltf, bytes)
}

/// Writes every bad model into a folder; gives each file's name, the code of its refusal, and words that its message has.
fn bad_models(folder: &Path) -> Vec<(&'static str, &'static str, Vec<&'static str>)> {
    let write = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes).unwrap();
    let changed = |name: &str, change: &dyn Fn(&mut Value)| {
        let mut gltf = triangle();
        change(&mut gltf);
        write(name, gltf.to_string().as_bytes());
    };
    write("triangle.bin", &triangle_bytes(1.0, 2));
    write("nan.bin", &triangle_bytes(f32::NAN, 2));
    write("index.bin", &triangle_bytes(1.0, 9));
    write("short.bin", &[0; 12]);
    write("good.gltf", triangle().to_string().as_bytes());
    let whole = glb(triangle(), &triangle_bytes(1.0, 2));
    write("good.glb", &whole);

    write("empty.glb", b"");
    write("text.gltf", b"dear diary");
    write("truncated.gltf", &triangle().to_string().as_bytes()[..200]);
    write("truncated.glb", &whole[..whole.len() - 20]);
    write("head.glb", &whole[..10]);
    write("version.glb", &[&whole[..4], &[9], &whole[5..]].concat());
    changed("count.gltf", &|g| g["accessors"][0]["count"] = json!(4));
    changed("huge_count.gltf", &|g| g["accessors"][0]["count"] = json!(4_000_000_000_u64));
    changed("view.gltf", &|g| g["bufferViews"][0]["byteLength"] = json!(1000));
    changed("offset.gltf", &|g| g["bufferViews"][0]["byteOffset"] = json!(u64::MAX - 3));
    changed("nan.gltf", &|g| g["buffers"][0]["uri"] = json!("nan.bin"));
    changed("index.gltf", &|g| g["buffers"][0]["uri"] = json!("index.bin"));
    changed("short.gltf", &|g| g["buffers"][0]["uri"] = json!("short.bin"));
    changed("no_buffer.gltf", &|g| g["buffers"][0]["uri"] = json!("nowhere.bin"));
    changed("outside.gltf", &|g| g["buffers"][0]["uri"] = json!("../../../../etc/passwd"));
    changed("5gb.gltf", &|g| g["buffers"][0]["byteLength"] = json!(5_u64 << 30));
    changed("5gb_data.gltf", &|g| g["buffers"][0] = json!({"byteLength": 5_u64 << 30, "uri": "data:;base64,AAAA"}));
    changed("no_mesh.gltf", &|g| g["nodes"][0]["mesh"] = json!(7));
    changed("no_accessor.gltf", &|g| g["meshes"][0]["primitives"][0]["indices"] = json!(7));
    changed("loop.gltf", &|g| g["nodes"][0]["children"] = json!([0]));
    changed("flat.gltf", &|g| g["nodes"][0]["scale"] = json!([1, 0, 1]));
    changed("draco.gltf", &|g| g["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]));
    changed("texture.gltf", &|g| {
        g["images"] = json!([{"uri": "nowhere.png"}]);
        g["textures"] = json!([{"source": 0}]);
        g["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
        g["meshes"][0]["primitives"][0]["material"] = json!(0);
    });
    vec![
        ("empty.glb", "bad-gltf", vec!["empty.glb", "hint:"]),
        ("text.gltf", "bad-gltf", vec!["neither GLB", "damaged"]),
        ("truncated.gltf", "bad-gltf", vec!["JSON", "line 1", "damaged"]),
        ("truncated.glb", "bad-gltf", vec!["needs", "bytes", "damaged"]),
        ("head.glb", "bad-gltf", vec!["GLB header", "damaged"]),
        ("version.glb", "bad-gltf", vec!["version 9"]),
        ("count.gltf", "bad-gltf", vec!["accessor 0", "needs 48 bytes", "36"]),
        ("huge_count.gltf", "too-large", vec!["accessor 0", "4000000000", "limit"]),
        ("view.gltf", "bad-gltf", vec!["buffer view 0", "1000"]),
        ("offset.gltf", "bad-gltf", vec!["buffer view 0"]),
        ("nan.gltf", "bad-gltf", vec!["accessor 0", "NaN", "not finite"]),
        ("index.gltf", "bad-gltf", vec!["index 2 is 9", "3 vertices"]),
        ("short.gltf", "bad-gltf", vec!["buffer 0", "12"]),
        ("no_buffer.gltf", "bad-gltf", vec!["buffer 0", "nowhere.bin", "relative to the file"]),
        ("outside.gltf", "outside-asset-roots", vec!["buffer 0", "passwd"]),
        ("5gb.gltf", "bad-gltf", vec!["buffer 0", "5368709120", "44"]),
        ("5gb_data.gltf", "bad-gltf", vec!["buffer 0", "5368709120"]),
        ("no_mesh.gltf", "bad-gltf", vec!["node 0", "mesh 7", "there are 1"]),
        ("no_accessor.gltf", "bad-gltf", vec!["accessor 7", "there are 2"]),
        ("loop.gltf", "bad-gltf", vec!["node 0", "not a tree"]),
        ("draco.gltf", "bad-gltf", vec!["KHR_draco_mesh_compression", "export it without"]),
        ("texture.gltf", "bad-gltf", vec!["image 0", "nowhere.png"]),
        ("nowhere.gltf", "bad-uri", vec!["there is no file", "check its spelling"]),
        (".", "bad-uri", vec!["not a regular file"]),
    ]
}

#[test]
fn bad_models_through_the_socket() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let models = folder.path().join("models");
    fs::create_dir(&models).unwrap();
    let bad = bad_models(&models);
    let roots = format!("[daemon]\nasset_roots = [{:?}]\n", models.to_str().unwrap());
    let daemon = Daemon::start_in(&folder, &lab::room_with(&roots)).unwrap();
    let mut client = daemon.client().unwrap();
    let before = (client.ask_ok("scene.get", json!({})).unwrap(), lab::everything(&mut client, "left").unwrap());
    for (name, code, words) in bad {
        let edits = json!([{"set": {"node": "ball", "visible": false}}, {"add": {"node": "model", "uri": name}}]);
        let refused = client.ask("scene.apply", json!({"edits": edits})).unwrap().unwrap_err();
        assert_eq!((refused.code.as_str(), refused.at.as_str()), (code, "edits[1].uri"), "{name}: {refused}");
        for word in words.iter().chain(&["hint:"]) {
            assert!(refused.message.contains(word), "{name}: `{}` does not say `{word}`", refused.message);
        }
    }
    // A panorama that is none.
    for uri in ["text.gltf", "triangle.bin", "nowhere.hdr"] {
        let edits = json!([{"environment": {"uri": uri}}]);
        let refused = client.ask("scene.apply", json!({"edits": edits})).unwrap().unwrap_err();
        assert!(refused.at == "edits[0].uri" && refused.message.contains("hint:"), "{uri}: {refused}");
    }
    assert_eq!(client.ask_ok("scene.get", json!({})).unwrap(), before.0);
    assert!(lab::everything(&mut client, "left").unwrap() == before.1, "another picture is shown");

    // The same without its fault is taken.
    for (node, uri) in [("one", "good.gltf"), ("two", "good.glb")] {
        client.apply(json!([{"add": {"node": node, "uri": uri}}])).unwrap();
    }
    assert_eq!(client.status().unwrap()["scene"]["nodes"], 4);
}

#[test]
fn bad_models_and_matrices_through_the_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let bad = bad_models(folder.path());
    let file = folder.path().join("lab.toml");
    let path = file.to_str().unwrap();
    for (name, code, words) in bad {
        let node = format!("[[scene.node]]\nname = \"model\"\n# a comment\nuri = {name:?}\n");
        let config = lab::room().replacen("[[scene.light]]", &(node + "[[scene.light]]"), 1);
        fs::write(&file, &config).unwrap();
        if code == "outside-asset-roots" {
            // The operator's own file may name what it likes; it is no buffer all the same.
            continue;
        }
        let output = harness::run("lanternd", &["check", "-c", path, "--json"]).unwrap();
        assert_eq!(output.status.code(), Some(1), "{name}");
        let told: Value = serde_json::from_slice(&output.stdout).unwrap();
        let [problem] = told["problems"].as_array().unwrap().as_slice() else { panic!("{name}: {told}") };
        let line = config.lines().position(|line| line.contains(&format!("{name:?}"))).unwrap() + 1;
        assert_eq!(
            (&problem["file"], &problem["line"], &problem["column"]),
            (&json!(path), &json!(line), &json!(7)),
            "{told}"
        );
        let (message, hint) = (problem["message"].as_str().unwrap(), problem["hint"].as_str().unwrap());
        assert!(message.contains("scene.node \"model\"") && !hint.is_empty() && !message.contains("hint"), "{told}");
        for word in words.iter().filter(|word| **word != "hint:") {
            assert!(message.contains(word) || hint.contains(word), "{name}: {told} does not say `{word}`");
        }
    }

    // A part of a model that is scaled to nothing, as animators hide things, is left out with a word.
    let config = lab::room().replace("\"lantern:sphere\"", "\"flat.gltf\"");
    fs::write(&file, &config).unwrap();
    let output = harness::run("lanternd", &["check", "-c", path]).unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && said.contains("warning: node \"ball\": node 0 is squeezed flat"), "{said}");

    // Each problem on its own line, all at once, in words.
    let view = format!("view = {:?}", lab::stand(1.0).view());
    let config = lab::room()
        .replace("uri = \"lantern:quad\"", "uri = \"lantern:quat\"")
        .replace("uri = \"lantern:sphere\"", "uri = \"nowhere.glb\"");
    fs::write(&file, &config).unwrap();
    let output = harness::run("lanternd", &["check", "-c", path]).unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    let lines: Vec<_> = said.lines().collect();
    let line = |text: &str| config.lines().position(|line| line.contains(text)).unwrap() + 1;
    assert!(lines[0].starts_with(&format!("{path}:{}:7: scene.node \"floor\":", line("quat"))), "{said}");
    assert!(lines[0].contains("hint:") && lines[0].contains("lantern:quad"), "{said}");
    assert!(lines[1].starts_with(&format!("{path}:{}:7: scene.node \"ball\":", line("nowhere"))), "{said}");

    let config = lab::room().replace(&view, "view = [[1,0,0,0],[0,1,0,0],[0,1,0,0],[0,0,0,1]]");
    fs::write(&file, &config).unwrap();
    let output = harness::run("lanternd", &["run", "-c", path]).unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        said.contains(&format!("{path}:{}:", line_of(&config, "[0,1,0,0],[0,1,0,0]"))) && said.contains("singular"),
        "{said}"
    );
}

fn line_of(text: &str, part: &str) -> usize {
    text.lines().position(|line| line.contains(part)).unwrap() + 1
}

#[test]
fn bad_configurations_change_nothing_when_reloaded() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let good = lab::room();
    let daemon = Daemon::start_in(&folder, &good).unwrap();
    let mut client = daemon.client().unwrap();
    client.apply(json!([lab::mirror()])).unwrap();
    let before = (client.ask_ok("scene.get", json!({})).unwrap(), lab::everything(&mut client, "right").unwrap());
    let file = folder.path().join("lantern.toml");
    for (config, words) in [
        (String::new(), vec!["there is no projector", "hint:"]),
        (good[..good.len() / 2].to_owned(), vec!["lantern.toml:", "hint:"]),
        (good.replace("samples = 1", "samples = 2"), vec!["lantern.toml:3:11:", "no square number"]),
        (good.replace("[scene]", "[scene]\nenviroment = 1"), vec!["unknown key `enviroment`", "`environment`"]),
        (
            good.replace("uri = \"lantern:quad\"", "uri = \"gone.glb\""),
            vec![":10:7: scene.node \"floor\"", "gone.glb", "hint:"],
        ),
        (good.replace("convention = \"opengl\"", "convention = \"directx\""), vec!["directx", "\"vulkan\""]),
        (
            good.replace("127.0.0.1:0", "192.0.2.1:7000"),
            vec!["tracker `optitrack` cannot listen at 192.0.2.1:7000", "hint:"],
        ),
        (good.replace("kind = \"headless\"", "kind = \"windwo\""), vec!["windwo", "did you mean \"window\""]),
        (good.replace("[96, 64]", "[16384, 16384]"), vec!["left"]),
        (good.replace("\"lantern\"", "\"vrpn\""), vec!["vrpn", "\"psn\"", "hint:"]),
    ] {
        assert_ne!(config, good);
        fs::write(&file, &config).unwrap();
        let refused = client.ask("config.reload", json!({})).unwrap().unwrap_err();
        for word in words {
            assert!(refused.message.contains(word), "`{}` does not say `{word}`", refused.message);
        }
        assert_eq!(client.ask_ok("scene.get", json!({})).unwrap(), before.0);
        assert!(lab::everything(&mut client, "right").unwrap() == before.1, "another picture is shown");
    }
    fs::remove_file(&file).unwrap();
    let refused = client.ask("config.reload", json!({})).unwrap().unwrap_err();
    assert!(refused.message.contains("cannot be read"), "{refused}");
}

#[test]
fn garbage_datagrams_are_counted() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    let before = lab::everything(&mut client, "left").unwrap();
    let to = client.status().unwrap()["trackers"]["optitrack"]["listen"].as_str().unwrap().to_owned();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();

    // Bytes of a small generator (Knuth's, MMIX): the same in every run.
    let mut state = 1u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as u8
    };
    let sent = 500;
    for round in 0..sent {
        let length = if round % 3 == 0 { 64 } else { round % 200 };
        let mut datagram: Vec<u8> = (0..length).map(|_| next()).collect();
        if round % 6 == 0 {
            datagram[..5].copy_from_slice(b"LNTP\x01");
            // A body that nobody knows, whatever else is right by chance.
            datagram[6..8].copy_from_slice(&999u16.to_le_bytes());
        }
        socket.send_to(&datagram, &to).unwrap();
        // Not faster than a socket's buffer is emptied: what the system drops cannot be counted.
        if round % 20 == 0 {
            thread::sleep(Duration::from_millis(5));
        }
    }
    let started = Instant::now();
    loop {
        let tracker = client.status().unwrap()["trackers"]["optitrack"].clone();
        assert_eq!(tracker["accepted"], 0, "{tracker}");
        if tracker["rejected"] == sent {
            assert!(tracker["last_reject"].is_string());
            break;
        }
        assert!(started.elapsed() < Duration::from_secs(10), "{tracker} of {sent}");
        thread::sleep(Duration::from_millis(20));
    }
    assert!(lab::everything(&mut client, "left").unwrap() == before, "another picture is shown");
}
