// Links that carry a program: its text, packed, behind the # of the address, which no server sees.

/** Longer texts are no programs that somebody wrote. */
const MOST_BYTES = 1_000_000;

async function through(stream, bytes, most = Infinity) {
  const writer = stream.writable.getWriter();
  const written = writer.write(bytes).then(() => writer.close());
  written.catch(() => {}); // whoever reads is told
  const parts = [];
  let size = 0;
  for (const reader = stream.readable.getReader(); ;) {
    const { value, done } = await reader.read();
    if (done) return new Uint8Array(await new Blob(parts).arrayBuffer());
    parts.push(value);
    size += value.length;
    if (size > most) throw new RangeError("it is too long");
  }
}

async function packed(text) {
  const bytes = await through(new CompressionStream("deflate-raw"), new TextEncoder().encode(text));
  let binary = "";
  for (const byte of bytes) binary += String.fromCharCode(byte);
  return btoa(binary).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
}

async function unpacked(text) {
  const binary = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
  const bytes = await through(new DecompressionStream("deflate-raw"), Uint8Array.from(binary, (one) => one.charCodeAt(0)), MOST_BYTES);
  return new TextDecoder("utf-8", { fatal: true }).decode(bytes);
}

/** What is asked besides the text; a link has those that are not the usual ones. */
const SETTINGS = ["robots", "rounds", "params", "policy", "seed"];
const USUAL = { robots: "", rounds: "20", params: "", policy: "first", seed: "0" };

/** What the address says behind its #: a program, or the name of an example, and settings. */
async function linked(hash) {
  const said = new URLSearchParams(hash.replace(/^#/, ""));
  const found = { example: said.get("example"), text: null };
  for (const name of SETTINGS) found[name] = said.get(name);
  if (said.has("program")) found.text = await unpacked(said.get("program"));
  return found;
}

async function linkTo(asked) {
  const said = new URLSearchParams();
  for (const name of SETTINGS) {
    const value = String(asked[name] ?? "");
    if (name === "rounds" || value !== USUAL[name]) said.set(name, value);
  }
  said.set("program", await packed(asked.text));
  return `${location.href.split("#")[0]}#${said}`;
}
