import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { brotliCompressSync, gzipSync } from "node:zlib";
import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig, type Plugin } from "vite";

// `npm run dev` serves the pages with the API of a running `apexcal serve` behind them. The service checks Host and
// Origin of every unsafe request, so the proxy presents itself as the service's own address.
const service = process.env.APEXCAL_URL ?? "http://127.0.0.1:8000";

const OUT = "../service/web";

/** All pages together, gzipped. */
const MOST_BYTES = 100_000;

/** Compresses what was built, once and well: the service sends the form that a browser takes. */
function compressed(): Plugin {
  return {
    name: "compressed",
    apply: "build",
    closeBundle() {
      let total = 0;
      for (const name of readdirSync(OUT, { recursive: true, encoding: "utf8" })) {
        if (!/\.(html|js|css|svg)$/.test(name)) continue;
        const bytes = readFileSync(`${OUT}/${name}`);
        const gzipped = gzipSync(bytes, { level: 9 });
        writeFileSync(`${OUT}/${name}.gz`, gzipped);
        writeFileSync(`${OUT}/${name}.br`, brotliCompressSync(bytes));
        total += gzipped.length;
      }
      if (total > MOST_BYTES) this.error(`The pages take ${total} bytes gzipped; at most ${MOST_BYTES} are allowed.`);
    },
  };
}

export default defineConfig({
  plugins: [svelte(), compressed()],
  build: {
    outDir: OUT,
    emptyOutDir: true,
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    target: "es2023",
  },
  server: {
    proxy: {
      "/v1": { target: service, changeOrigin: true, headers: { origin: service } },
    },
  },
});
