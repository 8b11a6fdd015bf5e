// Packs of numbers, as koord/sim/packing.py writes them.

async function inflated(text) {
  const bytes = fromBase64(text);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function fromBase64(text) {
  const binary = atob(text.trim());
  const bytes = new Uint8Array(binary.length);
  for (let k = 0; k < binary.length; k++) bytes[k] = binary.charCodeAt(k);
  return bytes;
}

/** The document of a pack, with its planes as `document.plane(name)`. */
function unpacked(bytes) {
  const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);
  const document = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  const planes = new Map();
  for (const [name, offset, size] of document.planes) {
    // A copy, so that numbers of several bytes lie where they must.
    planes.set(name, bytes.slice(4 + length + offset, 4 + length + offset + size));
  }
  document.plane = (name) => planes.get(name);
  return document;
}

/** Low bytes and high bytes as numbers of two bytes. */
function joined(plane) {
  const count = plane.length / 2;
  const whole = new Int16Array(count);
  for (let k = 0; k < count; k++) whole[k] = plane[k] | (plane[count + k] << 8);
  return whole;
}

/** Sums of differences, in place, in each run of `length` numbers. */
function summed(whole, length) {
  for (let start = 0; start < whole.length; start += length) {
    for (let k = start + 1; k < start + length; k++) whole[k] += whole[k - 1];
  }
  return whole;
}

/** An array with room for `room` numbers that begins like the old one. */
function grown(old, used, room) {
  if (room <= old.length) return old;
  const bigger = new old.constructor(Math.max(room, 2 * old.length));
  bigger.set(old.subarray(0, used));
  return bigger;
}
