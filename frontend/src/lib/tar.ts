/** Several files as one tar, whose bytes are those of the files where they lie: nothing is copied or written. */

const BLOCK = 512;
const encoder = new TextEncoder();

export interface Entry {
  path: string;
  file: Blob;
}

/** A tar (ustar) of some files, in the order of their paths: the same files make the same bytes. */
export function tarOf(entries: readonly Entry[], name: string): File {
  const parts: BlobPart[] = [];
  for (const { path, file } of [...entries].sort((one, other) => (one.path < other.path ? -1 : 1))) {
    parts.push(header(path, file.size), file, new Uint8Array(-file.size & (BLOCK - 1)));
  }
  return new File([...parts, new Uint8Array(2 * BLOCK)], `${name}.tar`);
}

function header(path: string, size: number): Uint8Array<ArrayBuffer> {
  const block = new Uint8Array(BLOCK);
  const put = (text: string, at: number): void => block.set(encoder.encode(text), at);
  const [folder, name] = split(path);
  put(name, 0);
  put("0000644\0" + "0000000\0".repeat(2), 100);
  // Eleven octal digits hold 8 GiB; a larger size is binary, its first bit set (GNU tar).
  if (size < 8 ** 11) put(size.toString(8).padStart(11, "0"), 124);
  else new DataView(block.buffer).setBigUint64(128, BigInt(size));
  if (size >= 8 ** 11) block[124] = 0x80;
  put("00000000000\0" + " ".repeat(8) + "0", 136);
  put("ustar\u000000", 257);
  put(folder, 345);
  const sum = block.reduce((total, value) => total + value, 0);
  put(`${sum.toString(8).padStart(6, "0")}\0 `, 148);
  return block;
}

/** A path as the format holds it: a folder of at most 155 bytes, and a name of at most 100. */
function split(path: string): [string, string] {
  const bytes = (text: string): number => encoder.encode(text).length;
  if (bytes(path) <= 100) return ["", path];
  for (let at = path.indexOf("/"); at >= 0; at = path.indexOf("/", at + 1)) {
    const [folder, name] = [path.slice(0, at), path.slice(at + 1)];
    if (bytes(folder) <= 155 && bytes(name) <= 100) return [folder, name];
  }
  throw new Error(`The name ${path} is too long; give the folder a shorter one, or pack it yourself.`);
}
