// Sends a frame of PosiStageNet by @jwetzell/posistagenet, and the trackers' names.
//
// psn.cjs ADDRESS:PORT TRACKERS: TRACKERS is JSON, [{id, name, position, rotation, speed?, validity?}, …]. Prints in how many packets it went.

const dgram = require("dgram");
const { Encoder, Tracker } = require("@jwetzell/posistagenet");

const [address, port] = process.argv[2].split(":");
const trackers = JSON.parse(process.argv[3]).map(({ id, name, position, rotation, speed, validity }) => {
  const tracker = new Tracker(id, name);
  tracker.setPos(...position);
  tracker.setOri(...rotation);
  if (speed) tracker.setSpeed(...speed);
  tracker.setStatus(validity ?? 1);
  return tracker;
});

const encoder = new Encoder("test", 2, 3);
const packets = encoder.getDataPackets(Date.now() * 1000, trackers);
const socket = dgram.createSocket("udp4");
const all = [...encoder.getInfoPackets(Date.now() * 1000, trackers), ...packets];

const next = () => {
  const packet = all.shift();
  if (packet === undefined) {
    console.log(packets.length);
    socket.close();
  } else {
    socket.send(packet, Number(port), address, next);
  }
};
next();
