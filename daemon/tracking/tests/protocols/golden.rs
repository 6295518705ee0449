//! What each protocol's packets say, in our frame. Where a pose points is worked out by hand: the images of a body's right,
//! top and back, never by the formula under test. Every pose is one that a mirrored or swapped axis would change.

use crate::packets::*;

/// cos and sin of 30°.
const C: f64 = 0.866_025_403_784_438_6;
const S: f64 = 0.5;

#[test]
fn freed_turns_as_people_say() {
    let mut listener = Listener::new("protocol = \"freed\"\nbodies = { \"1\" = \"head\", \"7\" = \"hand\" }");
    // FORMATS' golden vector: pan 180°, tilt 90°, roll −180°; 131069, 131070, 131071 mm. Whoever turns round faces back (+Z), then
    // looks up (+Y), the top of the head to the front; upside down the top is at the back, and right is right again.
    let golden = [
        0xd1, 0x01, 0x5a, 0, 0, 0x2d, 0, 0, 0xa6, 0, 0, 0x7f, 0xff, 0x40, 0x7f, 0xff, 0x80, 0x7f, 0xff, 0xc0, 1, 2, 3,
        4, 5, 6, 0, 0, 0x32,
    ];
    assert_eq!(freed(1, [180.0, 90.0, -180.0], [131_069.0, 131_070.0, 131_071.0])[..20], golden[..20]);
    listener.good(&golden);
    let upside_down = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];
    listener.stands("head", [131.069, 131.071, -131.07], upside_down);

    // A pan to the right: what was ahead is to the right; the right is behind.
    listener.good(&freed(7, [90.0, 0.0, 0.0], [1000.0, 2000.0, -3000.0]));
    listener.stands("hand", [1.0, -3.0, -2.0], [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]);
    // A tilt up by 30°: the back goes down, the top goes back.
    listener.good(&freed(7, [0.0, 30.0, 0.0], [0.0; 3]));
    listener.stands("hand", [0.0; 3], [[1.0, 0.0, 0.0], [0.0, C, S], [0.0, -S, C]]);
    // A roll clockwise from behind by 30°: the right goes down, the top to the right.
    listener.good(&freed(7, [0.0, 0.0, 30.0], [0.0; 3]));
    listener.stands("hand", [0.0; 3], [[C, -S, 0.0], [S, C, 0.0], [0.0, 0.0, 1.0]]);
    // All at once: pan last. Of a roll the right points a little down; tilted up by 90° "down" is ahead; panned to the right
    // "ahead" is right, and right is back.
    listener.good(&freed(7, [90.0, 90.0, 30.0], [0.0; 3]));
    listener.stands("hand", [0.0; 3], [[S, 0.0, C], [-C, 0.0, S], [0.0, -1.0, 0.0]]);

    // What is none.
    let good = freed(1, [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]);
    listener.bad(&good[..28], "28 bytes");
    listener.bad(&[&good[..], &[0]].concat(), "30 bytes");
    let other = [&[0xd0], &good[1..28], &[good[28].wrapping_add(1)]].concat();
    listener.bad(&other, "0xd0");
    listener.bad(&freed(9, [0.0; 3], [0.0; 3]), "body id 9");
}

#[test]
fn opentrack_has_six_numbers_and_their_signs() {
    let mut listener = Listener::new("protocol = \"opentrack\"\nbodies = { \"face\" = \"head\" }");
    // Yaw to the left, pitch up, roll clockwise from behind.
    listener.good(&opentrack([10.0, 20.0, 30.0, 90.0, 0.0, 0.0]));
    listener.stands("head", [0.1, 0.2, 0.3], [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
    listener.good(&opentrack([0.0, 0.0, 0.0, 0.0, 30.0, 0.0]));
    listener.stands("head", [0.0; 3], [[1.0, 0.0, 0.0], [0.0, C, S], [0.0, -S, C]]);
    listener.good(&opentrack([0.0, 0.0, 0.0, 0.0, 0.0, 30.0]));
    listener.stands("head", [0.0; 3], [[C, -S, 0.0], [S, C, 0.0], [0.0, 0.0, 1.0]]);
    // Together: rolled, then up by 90° ("down" is ahead, "up" is back), then to the left ("ahead" is left, "back" is right).
    listener.good(&opentrack([0.0, 0.0, 0.0, 90.0, 90.0, 30.0]));
    listener.stands("head", [0.0; 3], [[-S, 0.0, -C], [C, 0.0, -S], [0.0, -1.0, 0.0]]);
    listener.bad(&[0; 47], "47 bytes");
    listener.bad(&opentrack([0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0]), "not finite");
    listener.bad(&opentrack([0.0, 0.0, 0.0, 1e9, 0.0, 0.0]), "three turns");
    listener.bad(&opentrack([0.0, 1e12, 0.0, 0.0, 0.0, 0.0]), "beyond 1e8 m");

    let mut flipped = Listener::new("protocol = \"opentrack\"\nsigns = [-1, 1, -1, -1, 1, -1]");
    flipped.good(&opentrack([10.0, 20.0, 30.0, -90.0, 90.0, -30.0]));
    flipped.stands("head", [-0.1, 0.2, -0.3], [[-S, 0.0, -C], [C, 0.0, -S], [0.0, -1.0, 0.0]]);
}

/// A body of which right points ahead and a little up: 90° to the left, then rolled, in DTRACK's numbers for z up (x right,
/// y ahead, z up): right at (0, C, S), ahead at (−1, 0, 0), top at (0, −S, C).
fn dtrack_body(id: u32) -> String {
    // Columns: the images of the body's x (right), y (ahead) and z (top).
    format!("[{id} 1.000][100.5 200.25 300.125 0.1 0.2 0.3][0.0 {C} {S} -1.0 0.0 0.0 0.0 -{S} {C}]")
}

#[test]
fn dtrack_has_bodies_and_flysticks() {
    let keys = "protocol = \"dtrack\"\nbodies = { \"0\" = \"head\", \"flystick 0\" = \"hand\" }";
    let mut listener = Listener::new(keys);
    let frame = |number: u32, lines: &str| format!("fr {number}\r\nts 39596.024831\r\n6dcal 2\r\n{lines}\r\n");
    listener.good(frame(21753, &format!("6d 1 {}\r\n3d 1 [4 1.0][1 2 3]", dtrack_body(0))).as_bytes());
    // Right is ahead and a little up, the top up and a little back, ahead to the left: back to the right.
    let turned = [[0.0, S, -C], [0.0, C, S], [1.0, 0.0, 0.0]];
    listener.stands("head", [0.1005, 0.300125, -0.20025], turned);
    assert_eq!(listener.bodies.get("head").unwrap().measured_ns, Some(39_596_024_831_000));

    // Both kinds of Flysticks, with a place of three numbers as well; a bare 0 means the standard body.
    let short = dtrack_body(0).replace(" 0.1 0.2 0.3]", "]");
    let old = format!("6d 0\r\n6df 1 {}", short.replace("[0 1.000]", "[0 1.000 2]"));
    let status = listener.good(frame(21754, &old).as_bytes());
    listener.stands("hand", [0.1005, 0.300125, -0.20025], turned);
    let tracked = |status: &lantern_proto::status::TrackerStatus, id: &str| status.bodies[id].tracked;
    assert_eq!((tracked(&status, "0"), tracked(&status, "flystick 0")), (false, true), "{status:?}");
    let lost =
        "6d 1 [0 1.0][1 2 3][1 0 0 0 1 0 0 0 1]\r\n6df2 2 1 [0 -1.000 8 2][0 0 0][0 0 0 0 0 0 0 0 0][0 0.00 0.00]";
    let status = listener.good(frame(21755, lost).as_bytes());
    assert_eq!((tracked(&status, "0"), tracked(&status, "flystick 0")), (true, false), "{status:?}");
    listener.stands("hand", [0.1005, 0.300125, -0.20025], turned);

    // Frames that come late, and a measurement that is started anew.
    listener.bad(frame(21754, "6d 0").as_bytes(), "old: frame 21754 is not newer than 21755");
    listener.good(frame(1, "6d 0").as_bytes());

    let body = dtrack_body(0);
    let bad = [
        ("6d 2 ".to_owned() + &body, "before its last block"),
        ("6d 1 ".to_owned() + &body + &body, "after the last body"),
        ("6d 1 ".to_owned() + &body.replace("100.5 ", ""), "3 or 6"),
        ("6d 1 ".to_owned() + &body.replace("-1.0", "-1.1"), "no rotation"),
        ("6d 1 ".to_owned() + &body.replace("-1.0", "1.0"), "no rotation"),
        ("6d 1 ".to_owned() + &body.replace("-1.0", "nan"), "not finite"),
        ("6d 1 ".to_owned() + &body.replace("-1.0", "-1.0x"), "no number"),
        ("6d 1 ".to_owned() + &body.replace("[0 1", "[0.5 1"), "no id"),
        ("6d 99999999999999999999 ".to_owned() + &body, "no number"),
        ("6d 4000000000 ".to_owned() + &body, "claims 4000000000 bodies"),
        ("6d 1 ".to_owned() + &body.replace("100.5", "1e15"), "beyond 1e8 m"),
    ];
    for (lines, says) in bad {
        listener.bad(frame(2, &lines).as_bytes(), says);
    }
    listener.bad(b"hello", "no line `6d`");
    listener.bad("fr 1\r\n6d 0 \u{fc}".as_bytes(), "ASCII");
    assert_eq!(listener.hear(b"fr 3\r\nts 1.5\r\n").others.packets, 1);
}

#[test]
fn dtrack_may_have_y_up_and_passes_midnight() {
    let mut listener = Listener::new("protocol = \"dtrack\"\nup = \"y\"\nbodies = { \"3\" = \"head\" }");
    let mut time_ns = |number: u32, time: &str| {
        let line = format!("fr {number}\nts {time}\n6d 1 [3 1.0][1 2 3][0 {C} {S} -1 0 0 0 -{S} {C}]\n");
        listener.good(line.as_bytes());
        listener.stands("head", [0.001, 0.002, 0.003], [[0.0, C, S], [-1.0, 0.0, 0.0], [0.0, -S, C]]);
        listener.bodies.get("head").unwrap().measured_ns.unwrap()
    };
    let day_ns = 86_400_000_000_000;
    assert_eq!(time_ns(1, "86399.995"), day_ns - 5_000_000);
    assert_eq!(time_ns(2, "0.003333"), day_ns + 3_333_000);
    // A Flystick may be meant by a bare number where no standard body has it.
    let mut wand = Listener::new("protocol = \"dtrack\"");
    wand.good(b"fr 1\n6df 1 [1 1.0 2][1000 2000 3000][1 0 0 0 1 0 0 0 1]\n");
    wand.stands("head", [1.0, 3.0, -2.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
}

#[test]
fn psn_gathers_frames_and_knows_names() {
    let mut listener = Listener::new("protocol = \"psn\"\nbodies = { \"3\" = \"head\", \"Singer 1\" = \"hand\" }");
    // Left-handed with z ahead: a positive turn about y goes from ahead (z) to the right (x). 30° about it.
    let turn = vector(2, [0.0, 30f32.to_radians(), 0.0]);
    let fields = |x: f32| [vector(0, [x, 2.0, 3.0]), vector(1, [0.5, 0.25, 1.0]), turn.clone()].concat();
    let to_the_right = [[C, 0.0, S], [0.0, 1.0, 0.0], [-S, 0.0, C]];
    listener.good(&psn(psn_header(1000, 1, 1), &[(3, fields(1.0))]));
    listener.stands("head", [1.0, 2.0, -3.0], to_the_right);
    let pose = listener.bodies.get("head").unwrap();
    assert_eq!((pose.velocity_m_s.unwrap().to_array(), pose.measured_ns), ([0.5, 0.25, -1.0], Some(1_000_000)));

    // Names come beside the frames; before that, a tracker is its number.
    let status = listener.good(&psn(psn_header(2000, 2, 1), &[(3, fields(2.0)), (8, fields(9.0))]));
    assert_eq!(status.others.bodies, ["8"]);
    assert!(!status.bodies["Singer 1"].tracked);
    assert_eq!(listener.hear(&psn_names(&[(3, "Bass"), (8, "Singer 1")])).others.packets, 1);
    let status = listener.good(&psn(psn_header(3000, 3, 1), &[(3, fields(3.0)), (8, fields(9.0))]));
    listener.stands("hand", [9.0, 2.0, -3.0], to_the_right);
    assert!(status.bodies["Singer 1"].tracked);

    // A frame of two packets moves both when it is whole, in either order.
    let [first, second] = [(3, 4.0), (8, 5.0)].map(|(id, x)| psn(psn_header(4000, 4, 2), &[(id, fields(x))]));
    let generation = listener.bodies.generation();
    listener.good(&second);
    assert_eq!(listener.bodies.generation(), generation, "half of a frame has moved something");
    listener.good(&first);
    assert_eq!((listener.pose("head").0.x, listener.pose("hand").0.x), (4.0, 5.0));

    // One of which a packet is lost moves nothing and is counted; one that comes twice is old.
    listener.good(&psn(psn_header(5000, 5, 2), &[(3, fields(50.0))]));
    listener.bad(&psn(psn_header(5000, 5, 2), &[(3, fields(51.0))]), "has tracker 3 already");
    let status = listener.good(&psn(psn_header(6000, 6, 1), &[(3, fields(6.0))]));
    assert_eq!((status.incomplete, listener.pose("head").0.x, listener.pose("hand").0.x), (1, 6.0, 5.0));
    // The other is not seen any more, and keeps its pose.
    assert!(status.bodies["3"].tracked && !status.bodies["Singer 1"].tracked);
    let invalid = [fields(7.0), chunk(3, false, &0f32.to_le_bytes())].concat();
    let status = listener.good(&psn(psn_header(7000, 7, 1), &[(3, invalid)]));
    assert!(!status.bodies["3"].tracked && listener.pose("head").0.x == 6.0);

    // Late ones are old; a server that starts anew is heard; so is one that counts nothing.
    listener.bad(&psn(psn_header(6500, 6, 1), &[(3, fields(8.0))]), "old: 6500");
    listener.good(&psn(psn_header(5_000_000, 8, 1), &[(3, fields(8.0))]));
    listener.good(&psn(psn_header(10, 0, 1), &[(3, fields(9.0))]));
    listener.good(&psn(psn_header(10, 0, 1), &[(3, fields(10.0))]));
    assert_eq!(listener.pose("head").0.x, 10.0);
    // Position alone leaves the orientation, and the other way round.
    listener.good(&psn(psn_header(20, 0, 1), &[(3, vector(0, [1.0, 1.0, 1.0]))]));
    listener.stands("head", [1.0, 1.0, -1.0], to_the_right);
    listener.good(&psn(psn_header(30, 0, 1), &[(3, vector(2, [0.0; 3]))]));
    listener.stands("head", [1.0, 1.0, -1.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);

    let good = psn(psn_header(40, 1, 1), &[(3, fields(1.0))]);
    listener.bad(&[&good[..], &[0]].concat(), "1 bytes after the packet");
    listener.bad(&psn(psn_header(40, 1, 0), &[]), "no packets");
    listener.bad(&chunk(0x6755, true, &chunk(1, true, &[])), "without its header");
    listener.bad(&chunk(0x6757, true, &[]), "neither data nor info");
    let old = chunk(0, false, &[&[0; 8][..], &[1, 0, 1, 1]].concat());
    listener.bad(&psn(old, &[(3, fields(1.0))]), "version 1");
    listener.bad(&psn(psn_header(40, 1, 1), &[(3, vector(0, [f32::NAN, 0.0, 0.0]))]), "non-finite");
    listener.bad(&psn(psn_header(40, 1, 1), &[(3, chunk(0, false, &[0; 13]))]), "1 bytes too many");
}

#[test]
fn psn_servers_come_and_go() {
    let mut listener = Listener::new("protocol = \"psn\"\nbodies = { \"3\" = \"head\", \"8\" = \"hand\" }");
    let place = |x: f32| vector(0, [x, 2.0, 3.0]);
    let other = "127.0.0.1:5001";
    listener.good(&psn(psn_header(1000, 1, 1), &[(3, place(1.0))]));
    listener.hear_from(&psn(psn_header(900_000, 1, 1), &[(8, place(2.0))]), other);
    // What one does not see the other may.
    let status = listener.good(&psn(psn_header(2000, 2, 1), &[]));
    assert!(status.bodies.values().all(|body| body.tracked), "{status:?}");
    // The other has gone: what this one does not see nobody does.
    listener.now += std::time::Duration::from_secs(5);
    let status = listener.good(&psn(psn_header(5_002_000, 3, 1), &[(3, place(3.0))]));
    assert_eq!(status.bodies.values().map(|body| body.tracked).collect::<Vec<_>>(), [true, false]);
    // It is back, and counts as before.
    listener.hear_from(&psn(psn_header(6_000_000, 2, 1), &[(8, place(2.0))]), other);
    let status = listener.good(&psn(psn_header(5_012_000, 4, 1), &[]));
    assert!(status.bodies.values().all(|body| body.tracked), "{status:?}");
}

#[test]
fn psn_names_move_to_other_trackers() {
    let mut listener = Listener::new("protocol = \"psn\"\nbodies = { \"3\" = \"head\", \"Singer 1\" = \"hand\" }");
    let frame = |time_us: u64, x: f32| psn(psn_header(time_us, 1, 1), &[(3, vector(0, [x, 2.0, 3.0]))]);
    listener.hear(&psn_names(&[(3, "Singer 1")]));
    listener.good(&frame(1000, 1.0));
    // The names of a frame may come in several packets: what is not in this one stays.
    listener.hear(&psn_names(&[(4, "Bass")]));
    listener.good(&frame(2000, 2.0));
    assert_eq!((listener.pose("head").0.x, listener.pose("hand").0.x), (0.0, 2.0));
    // Tracker 3 is called otherwise from now on, by a name that nobody asked for.
    listener.hear(&psn_names(&[(3, "Bass")]));
    listener.good(&frame(3000, 3.0));
    assert_eq!((listener.pose("head").0.x, listener.pose("hand").0.x), (3.0, 2.0));
}

#[test]
fn natnet_frames_of_every_version() {
    for (version, name) in [((3, 0), "3.0"), ((3, 1), "3.1"), ((4, 0), "4.0"), ((4, 1), "4.1")] {
        let keys =
            format!("protocol = \"natnet\"\nversion = \"{name}\"\nbodies = {{ \"1\" = \"head\", \"2\" = \"hand\" }}");
        let mut listener = Listener::new(&keys);
        // 90° to the left and then rolled: as of DTRACK above, in our own axes.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let left = [0.0, half, 0.0, half];
        let head = (1, [0.1, 0.2, 0.3], left, true);
        let status =
            listener.good(&natnet(version, 100, 12.5, &[head, (2, [1.0; 3], left, true), (9, [0.0; 3], left, true)]));
        listener.stands("head", [0.1, 0.2, 0.3], [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
        assert_eq!(listener.bodies.get("head").unwrap().measured_ns, Some(12_500_000_000));
        assert_eq!(status.others.bodies, ["9"]);
        assert!(status.bodies.values().all(|body| body.tracked));

        // Not tracked, whatever stands there; or not there at all.
        let lost = (1, [f32::NAN; 3], [0.0; 4], false);
        let status = listener.good(&natnet(version, 101, 12.5, &[lost]));
        assert!(status.bodies.values().all(|body| !body.tracked), "{status:?}");
        assert!((listener.pose("head").0.x - 0.1).abs() < 1e-6);
        listener.bad(&natnet(version, 99, 12.5, &[head]), "old: frame 99");
        // Others alone are everything that it sees.
        listener.good(&natnet(version, 101, 12.5, &[head]));
        let status = listener.good(&natnet(version, 101, 12.5, &[(9, [0.0; 3], left, true)]));
        assert!(status.bodies.values().all(|body| !body.tracked), "{status:?}");

        // One that is broken spoils all.
        let broken = (2, [1.0, f32::INFINITY, 1.0], left, true);
        listener.bad(&natnet(version, 102, 12.5, &[(1, [9.0; 3], left, true), broken]), "non-finite position");
        listener.bad(&natnet(version, 102, 12.5, &[(1, [9.0; 3], [0.0, 0.0, 0.0, 2.0], true)]), "norm 2.0000");
        listener.bad(&natnet(version, 102, 12.5, &[(1, [1e9; 3], left, true)]), "beyond 1e8 m");
        let good = natnet(version, 102, 12.5, &[head]);
        listener.bad(&good[..good.len() - 1], "claims");
        let mut lie = natnet_message(7, &[&good[4..], &[0]].concat());
        listener.bad(&lie, "after the end");
        lie.truncate(3);
        listener.bad(&lie, "inside the header");
        assert_eq!(listener.hear(&natnet_message(8, b"text")).others.last.as_deref(), Some("message 8"));
        // Read by another version's layout it is refused, not misread.
        let other = if version == (4, 1) { (4, 0) } else { (4, 1) };
        listener.bad(&natnet(other, 102, 12.5, &[head]), &format!("read as NatNet {name}"));
    }
}

#[test]
fn natnet_learns_its_version_from_the_server() {
    let keys = "protocol = \"natnet\"\nserver = \"127.0.0.1\"";
    let mut listener = Listener::new(keys);
    let head = (1, [0.1, 0.2, 0.3], [0.0, 0.0, 0.0, 1.0], true);
    let frame = natnet((4, 0), 1, 1.0, &[head]);
    listener.bad(&frame, "127.0.0.1:1510 has not answered");
    let status = listener.hear(&natnet_answer([4, 0]));
    assert!(status.last_reject.unwrap().contains("was not asked"));
    let status = listener.hear_from(&natnet_answer([2, 9]), "127.0.0.1:1510");
    assert!(status.last_reject.unwrap().contains("NatNet 2.9"));
    let rejected = status.rejected;
    let status = listener.hear_from(&natnet_answer([4, 0]), "127.0.0.1:1510");
    assert_eq!((status.rejected, status.others.packets), (rejected, 1));
    listener.good(&frame);
    listener.bad(&natnet((4, 1), 2, 1.0, &[head]), "read as NatNet 4.0");

    // A socket that hears both families hears an IPv4 server so, whether it was named or found by its frames.
    for keys in [keys, "protocol = \"natnet\""] {
        let mut listener = Listener::new(&format!("{keys}\nlisten = \"[::]:1511\""));
        listener.hear_from(&frame, "[::ffff:127.0.0.1]:1511");
        listener.hear_from(&natnet_answer([4, 0]), "[::ffff:127.0.0.1]:1510");
        let status = listener.hear_from(&frame, "[::ffff:127.0.0.1]:1511");
        assert_eq!((status.others.packets, status.accepted), (1, 1), "{keys}: {status:?}");
    }
}

/// The pose that Unity shows as position (1, 2, 3), turned by 30° about y, to the right: in its left-handed numbers.
const UNITY: [f32; 7] = [1.0, 2.0, 3.0, 0.0, 0.258_819_05, 0.0, 0.965_925_8];
const TO_THE_RIGHT: [[f64; 3]; 3] = [[C, 0.0, S], [0.0, 1.0, 0.0], [-S, 0.0, C]];

#[test]
fn osc_of_vmc() {
    let keys = "protocol = \"osc\"\npreset = \"vmc\"\nbodies = { \"LHR-1\" = \"head\", \"7\" = \"hand\" }";
    let mut listener = Listener::new(keys);
    listener.good(&osc("/VMC/Ext/Hmd/Pos", Some("LHR-1"), &UNITY));
    listener.stands("head", [1.0, 2.0, -3.0], TO_THE_RIGHT);
    listener.good(&osc("/VMC/Ext/Tra/Pos", Some("7"), &UNITY));
    listener.stands("hand", [1.0, 2.0, -3.0], TO_THE_RIGHT);

    // In a bundle, with its time, among other messages.
    let others =
        [osc("/VMC/Ext/T", None, &[1.0]), osc("/VMC/Ext/Con/Pos", Some("LHR-1"), &[9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])];
    listener.good(&osc_bundle(10 << 32 | 1 << 31, &others));
    assert_eq!(listener.pose("head").0.x, 9.0);
    assert_eq!(listener.bodies.get("head").unwrap().measured_ns, Some(10_500_000_000));

    let status = listener.hear(&osc("/VMC/Ext/Blend/Val", Some("Joy"), &[1.0]));
    assert_eq!((status.others.packets, status.others.last.as_deref()), (1, Some("message /VMC/Ext/Blend/Val")));
    listener.bad(&osc("/VMC/Ext/Hmd/Pos", Some("LHR-2"), &UNITY), "body id LHR-2");
    listener.bad(&osc("/VMC/Ext/Hmd/Pos", Some("LHR-1"), &UNITY[..6]), "without its 7 numbers");
    listener.bad(&osc("/VMC/Ext/Hmd/Pos", None, &UNITY), "without a name");
    let mut nan = UNITY;
    nan[1] = f32::NAN;
    listener.bad(&osc("/VMC/Ext/Hmd/Pos", Some("LHR-1"), &nan), "non-finite position");
    // One broken element spoils its bundle, whatever stands before it.
    let good = osc("/VMC/Ext/Hmd/Pos", Some("LHR-1"), &UNITY);
    listener.bad(&osc_bundle(1, &[good.clone(), osc("/VMC/Ext/Hmd/Pos", Some("LHR-1"), &nan)]), "non-finite");
    listener.bad(&osc_bundle(1, &[good.clone(), good[..8].to_vec()]), "without its end");
    listener.bad(&[osc_bundle(1, std::slice::from_ref(&good)), vec![0; 3]].concat(), "odd end");
    listener.bad(&[good.clone(), vec![0; 4]].concat(), "4 bytes after");
}

#[test]
fn osc_has_bounds() {
    let mut listener = Listener::new("protocol = \"osc\"\npreset = \"vmc\"");
    let nested = |depth: usize| (0..depth).fold(osc("/a", None, &[]), |inner, _| osc_bundle(1, &[inner]));
    assert_eq!(listener.hear(&nested(8)).others.packets, 1);
    listener.bad(&nested(9), "8 deep");
    // As deep as a datagram can be: crate rosc alone would follow it to the end of the stack.
    listener.bad(&nested(3000), "8 deep");
    let arrays = [osc_string("/a"), osc_string(&format!(",{}{}", "[".repeat(30_000), "]".repeat(30_000)))].concat();
    listener.bad(&arrays, "60000 arguments");
    let array = [osc_string("/a"), osc_string(",[i]"), vec![0; 4]].concat();
    listener.bad(&array, "array");
    listener.bad(&osc_bundle(1, &vec![vec![]; 3000]), "more than 2048 messages");
    assert_eq!(listener.hear(&osc_bundle(1, &[])).others.last.as_deref(), Some("an empty bundle"));
}

#[test]
fn osc_of_vrchat() {
    let mut listener =
        Listener::new("protocol = \"osc\"\npreset = \"vrchat\"\nbodies = { \"1\" = \"head\", \"head\" = \"hand\" }");
    // About z first, then x, then y, left-handed with z ahead: a positive turn about x brings ahead (z) down, one about z brings
    // the right (x) up. So 90° about x look down, with the top to the front; then 30° about y turn that to the right.
    listener.good(&osc("/tracking/trackers/1/position", None, &[1.0, 2.0, 3.0]));
    listener.good(&osc("/tracking/trackers/1/rotation", None, &[90.0, 30.0, 0.0]));
    listener.stands("head", [1.0, 2.0, -3.0], [[C, 0.0, S], [S, 0.0, -C], [0.0, 1.0, 0.0]]);
    // Right goes up by 30°, then looking down takes what is up to the front.
    let both = [
        osc("/tracking/trackers/head/rotation", None, &[90.0, 0.0, 30.0]),
        osc("/tracking/trackers/head/position", None, &[4.0, 5.0, 6.0]),
    ];
    listener.good(&osc_bundle(1, &both));
    listener.stands("hand", [4.0, 5.0, -6.0], [[C, 0.0, -S], [-S, 0.0, -C], [0.0, 1.0, 0.0]]);
    listener.bad(&osc("/tracking/trackers/2/position", None, &[1.0, 2.0, 3.0]), "body id 2");
    listener.bad(&osc("/tracking/trackers/1/rotation", None, &[f32::NAN, 0.0, 0.0]), "angles");
    listener.bad(&osc("/tracking/trackers/1/position", None, &[1.0, 2.0]), "3 numbers");
    assert_eq!(listener.hear(&osc("/tracking/eye/EyesClosedAmount", None, &[1.0])).others.packets, 1);
}

#[test]
fn osc_of_optitracks_bridges() {
    let mut listener = Listener::new("protocol = \"osc\"\npreset = \"optitrack\"");
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let numbers = [0.1, 0.2, 0.3, 0.0, half, 0.0, half];
    let left = [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    listener.good(&osc("/rigidbody/1/transformation", None, &numbers));
    listener.stands("head", [0.1, 0.2, 0.3], left);
    let rb = |kind: i32, rest: &[f32]| {
        let tags = format!(",ii{}", "f".repeat(rest.len()));
        let rest = rest.iter().flat_map(|x| x.to_be_bytes()).collect();
        [osc_string("/rb"), osc_string(&tags), 1i32.to_be_bytes().to_vec(), kind.to_be_bytes().to_vec(), rest].concat()
    };
    listener.good(&rb(2, &[7.5, 1.1, 0.2, 0.3, 0.0, half, 0.0, half]));
    listener.stands("head", [1.1, 0.2, 0.3], left);
    assert_eq!(listener.bodies.get("head").unwrap().measured_ns, Some(7_500_000_000));
    assert!(!listener.good(&rb(0, &[0.0])).bodies["1"].tracked);
    assert_eq!(listener.hear(&rb(0, &[1.0])).others.packets, 1);
    assert!(!listener.good(&osc("/rigidbody/1/tracked", None, &[0.0])).bodies["1"].tracked);
    listener.bad(&rb(2, &[7.5, 1.1]), "8 numbers");

    // The bridges go on sending the last pose of a body that is lost: it is none until they say that it is tracked again,
    // whatever stands first in a datagram.
    let transformation = |x: f32| osc("/rigidbody/1/transformation", None, &[&[x], &numbers[1..]].concat());
    let tracked = |flag: f32| osc("/rigidbody/1/tracked", None, &[flag]);
    assert!(!listener.good(&transformation(5.0)).bodies["1"].tracked);
    assert!((listener.pose("head").0.x - 1.1).abs() < 1e-6);
    assert!(!listener.good(&osc_bundle(1, &[tracked(0.0), transformation(5.0)])).bodies["1"].tracked);
    assert!(!listener.good(&rb(2, &[7.5, 5.0, 0.2, 0.3, 0.0, half, 0.0, half])).bodies["1"].tracked);
    assert!((listener.pose("head").0.x - 1.1).abs() < 1e-6);
    // Either of the two forms says so, and what is broken says nothing.
    listener.bad(&osc_bundle(1, &[tracked(1.0), osc("/rigidbody/1/transformation", None, &[])]), "7 numbers");
    assert!(!listener.good(&transformation(5.0)).bodies["1"].tracked);
    assert!(listener.good(&osc_bundle(1, &[transformation(2.0), tracked(1.0)])).bodies["1"].tracked);
    assert!(!listener.good(&osc_bundle(1, &[transformation(3.0), tracked(0.0)])).bodies["1"].tracked);
    assert_eq!(listener.pose("head").0.x, 2.0);
    listener.hear(&rb(0, &[1.0]));
    assert!(listener.good(&transformation(4.0)).bodies["1"].tracked);
    assert_eq!(listener.pose("head").0.x, 4.0);
    listener.bad(&osc("/rb", None, &[]), "without an id");
}

#[test]
fn osc_as_the_user_describes_it() {
    let keys = "protocol = \"osc\"\naddress = \"/lab/{id}/*\"\narguments = [\"time\", \"x\", \"y\", \"z\", \"_\", \"qx\", \"qy\", \"qz\", \
                \"qw\"]\naxes = \"z-up\"\nunits = \"mm\"\nbodies = { \"cap\" = \"head\", \"7\" = \"hand\" }";
    let mut listener = Listener::new(keys);
    // 30° about z (up) to the left, of x right, y ahead, z up.
    let numbers = [2.5, 100.0, 200.0, 300.0, 5.0, 0.0, 0.0, 0.258_819_05, 0.965_925_8];
    listener.good(&osc("/lab/cap/pose", None, &numbers));
    listener.stands("head", [0.1, 0.3, -0.2], [[C, 0.0, -S], [0.0, 1.0, 0.0], [S, 0.0, C]]);
    assert_eq!(listener.bodies.get("head").unwrap().measured_ns, Some(2_500_000_000));
    listener.good(&osc("/lab/7/x", None, &numbers));
    listener.bad(&osc("/lab/hat/pose", None, &numbers), "body id hat");
    for address in ["/lab/cap", "/lab/cap/pose/x", "/lob/cap/pose", "/lab//pose"] {
        let before = listener.source.status().others.packets;
        assert_eq!(listener.hear(&osc(address, None, &numbers)).others.packets, before + 1, "{address}");
    }
    listener.bad(&osc("/lab/cap/pose", None, &numbers[..8]), "8 arguments, and `arguments` describes 9");

    // An id among the arguments; whole numbers and doubles; position alone.
    let mut by_argument = Listener::new(
        "protocol = \"osc\"\naddress = \"/p\"\narguments = [\"id\", \"x\", \"y\", \"z\"]\naxes = \"z-up-left\"",
    );
    let message =
        [osc_string("/p"), osc_string(",iidf"), 1i32.to_be_bytes().to_vec(), 5i32.to_be_bytes().to_vec()].concat();
    by_argument.good(&[&message[..], &6.5f64.to_be_bytes(), &7.0f32.to_be_bytes()].concat());
    assert_eq!(by_argument.pose("head").0.to_array(), [6.5, 7.0, -5.0]);
    by_argument.bad(&osc("/p", Some("2"), &[1.0, 2.0, 3.0]), "body id 2");
    by_argument.bad(
        &[osc_string("/p"), osc_string(",ssff"), osc_string("1"), osc_string("x"), vec![0; 8]].concat(),
        "no number",
    );

    // One body; and bodies by their whole paths.
    let mut only = Listener::new(
        "protocol = \"osc\"\naddress = \"/head\"\narguments = [\"rx\", \"ry\", \"rz\"]\nbodies = { \"any\" = \"head\" }",
    );
    only.good(&osc("/head", None, &[0.0, 30.0, 0.0]));
    only.stands("head", [0.0; 3], [[C, 0.0, -S], [0.0, 1.0, 0.0], [S, 0.0, C]]);
    let mut paths = Listener::new(
        "protocol = \"osc\"\naddress = \"/*/pos\"\narguments = [\"x\", \"y\", \"z\"]\nbodies = { \"/cap/pos\" = \"head\" }",
    );
    paths.good(&osc("/cap/pos", None, &[1.0, 2.0, 3.0]));
    assert_eq!(paths.pose("head").0.to_array(), [1.0, 2.0, 3.0]);
    paths.bad(&osc("/hat/pos", None, &[1.0, 2.0, 3.0]), "body id /hat/pos");
}
