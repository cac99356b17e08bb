import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { brotliCompressSync, gzipSync } from "node:zlib";
import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig, type Plugin, type Rolldown } from "vite";

// `npm run dev` serves the pages with the API of a running `apexcal serve` behind them. The service checks Host and
// Origin of every unsafe request, so the proxy presents itself as the service's own address.
const service = process.env.APEXCAL_URL ?? "http://127.0.0.1:8000";

const OUT = "../service/web";

/** Limits, gzipped: of what every page loads, and of what pages with points in 3D load. */
const MOST_BYTES = 100_000;
const MOST_BYTES_WITH_VIEWER = 300_000;

/** Compresses what was built, once and well: the service sends the form that a browser takes. */
function compressed(): Plugin {
  let later = new Set<string>();
  return {
    name: "compressed",
    apply: "build",
    generateBundle(_, bundle) {
      later = loadedLater(bundle);
    },
    closeBundle() {
      let [first, all] = [0, 0];
      for (const name of readdirSync(OUT, { recursive: true, encoding: "utf8" })) {
        if (!/\.(html|js|css|svg)$/.test(name)) continue;
        const bytes = readFileSync(`${OUT}/${name}`);
        const gzipped = gzipSync(bytes, { level: 9 });
        writeFileSync(`${OUT}/${name}.gz`, gzipped);
        writeFileSync(`${OUT}/${name}.br`, brotliCompressSync(bytes));
        all += gzipped.length;
        if (!later.has(name)) first += gzipped.length;
      }
      const said = `The pages take ${first} bytes gzipped, ${all} with the viewer`;
      if (first > MOST_BYTES || all > MOST_BYTES_WITH_VIEWER) {
        this.error(`${said}; at most ${MOST_BYTES} and ${MOST_BYTES_WITH_VIEWER} are allowed.`);
      }
      this.info(`${said}.`);
    },
  };
}

/** Scripts and styles that no page loads at once. */
function loadedLater(bundle: Rolldown.OutputBundle): Set<string> {
  const chunks = Object.values(bundle).filter((one) => one.type === "chunk");
  const first = new Set(chunks.filter((chunk) => chunk.isEntry).map((chunk) => chunk.fileName));
  for (const name of first) {
    for (const next of chunks.find((chunk) => chunk.fileName === name)?.imports ?? []) first.add(next);
  }
  const later = chunks.filter((chunk) => !first.has(chunk.fileName));
  return new Set(later.flatMap((chunk) => [chunk.fileName, ...(chunk.viteMetadata?.importedCss ?? [])]));
}

export default defineConfig({
  plugins: [svelte(), compressed()],
  build: {
    outDir: OUT,
    emptyOutDir: true,
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    target: "es2023",
    chunkSizeWarningLimit: 700, // three.js, which is loaded later
  },
  server: {
    proxy: {
      "/v1": { target: service, changeOrigin: true, headers: { origin: service } },
    },
  },
});
