import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { brotliCompressSync, gzipSync } from "node:zlib";
import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig, type Plugin } from "vite";
import { writeHelp } from "./help.ts";

// `npm run dev` serves the pages with the API of a running `apexcal serve` behind them. The service checks Host and
// Origin of every unsafe request, so the proxy presents itself as the service's own address.
const service = process.env.APEXCAL_URL ?? "http://127.0.0.1:8000";

const OUT = "../service/web";

/** Compresses what was built, once and well: the service sends the form that a browser takes. */
const compressed = (): Plugin => ({
  name: "compressed",
  apply: "build",
  closeBundle() {
    writeHelp("../docs", `${OUT}/docs`);
    for (const name of readdirSync(OUT, { recursive: true, encoding: "utf8" })) {
      if (!/\.(html|js|css|svg)$/.test(name)) continue;
      const bytes = readFileSync(`${OUT}/${name}`);
      writeFileSync(`${OUT}/${name}.gz`, gzipSync(bytes, { level: 9 }));
      writeFileSync(`${OUT}/${name}.br`, brotliCompressSync(bytes));
    }
  },
});

/** Puts script and style into the page, so that one file is all: a worker writes a result's numbers into it. */
function inlined(): Plugin {
  // Nothing in a script may look like an end tag or a comment of the page around it.
  const harmless = (code: string): string => code.replace(/<(?=!--|\/?script)/gi, "\\x3C");
  return {
    name: "inlined",
    apply: "build",
    enforce: "post",
    generateBundle(_, bundle) {
      const files = Object.values(bundle);
      const [page] = files.filter((one) => one.type === "asset" && one.fileName.endsWith(".html"));
      const scripts = files.flatMap((one) => (one.type === "chunk" ? [harmless(one.code)] : []));
      const styles = files.flatMap((one) => (one.fileName.endsWith(".css") && "source" in one ? [one.source] : []));
      if (page?.type !== "asset" || scripts.length !== 1) this.error("The report is one page with one script.");
      const head = String(page.source).replace(/<(script type="module"|link rel="stylesheet")[^>]*>(<\/script>)?/g, "");
      page.source = head
        .replace("</head>", () => `<style>${styles.join("")}</style></head>`)
        .replace("</body>", () => `<script type="module">${scripts.join("")}</script></body>`);
      for (const name of Object.keys(bundle)) if (bundle[name] !== page) Reflect.deleteProperty(bundle, name);
    },
  };
}

export default defineConfig(({ mode }) => ({
  plugins: mode === "report" ? [svelte(), inlined()] : [svelte(), compressed()],
  build: {
    ...(mode === "report"
      ? {
          outDir: "../workers/reports",
          emptyOutDir: false,
          copyPublicDir: false,
          rolldownOptions: { input: "report.html" },
        }
      : { outDir: OUT, emptyOutDir: true, manifest: true }),
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
}));
