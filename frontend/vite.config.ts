import { copyFileSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { brotliCompressSync, gzipSync } from "node:zlib";
import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig, type Plugin, type Rolldown } from "vite";

// `npm run dev` serves the pages with the API of a running `apexcal serve` behind them. The service checks Host and
// Origin of every unsafe request, so the proxy presents itself as the service's own address.
const service = process.env.APEXCAL_URL ?? "http://127.0.0.1:8000";

const OUT = "../service/web";

/** Limits, gzipped: of what a page loads before its points in 3D, and of all that it can load. */
const MOST_BYTES = 100_000;
const MOST_BYTES_WITH_VIEWER = 300_000;

/** Compresses what was built, once and well: the service sends the form that a browser takes. */
function compressed(): Plugin {
  const chunks: Rolldown.OutputChunk[] = [];
  return {
    name: "compressed",
    apply: "build",
    generateBundle(_, bundle) {
      chunks.push(...Object.values(bundle).filter((one) => one.type === "chunk"));
    },
    closeBundle() {
      // Each page has a link to its document, which a browser shows as text.
      mkdirSync(`${OUT}/docs`, { recursive: true });
      for (const name of readdirSync("../docs").filter((one) => one.endsWith(".md"))) {
        copyFileSync(`../docs/${name}`, `${OUT}/docs/${name.replace(".md", ".txt")}`);
      }
      const gzipped = new Map<string, number>();
      for (const name of readdirSync(OUT, { recursive: true, encoding: "utf8" })) {
        if (!/\.(html|js|css|svg)$/.test(name)) continue;
        const bytes = readFileSync(`${OUT}/${name}`);
        const small = gzipSync(bytes, { level: 9 });
        writeFileSync(`${OUT}/${name}.gz`, small);
        writeFileSync(`${OUT}/${name}.br`, brotliCompressSync(bytes));
        gzipped.set(name, small.length);
      }
      const sum = (names: Iterable<string>): number =>
        [...new Set(names)].reduce((bytes, name) => bytes + (gzipped.get(name) ?? 0), 0);
      const shell = [
        "index.html",
        "icon.svg",
        ...neededBy(
          chunks.filter((one) => one.isEntry),
          chunks,
        ),
      ];
      const said = [`The first load takes ${sum(shell)} bytes gzipped`];
      for (const page of chunks.filter((one) => one.facadeModuleId?.includes("/src/pages/"))) {
        const before = sum([...shell, ...neededBy([page], chunks)]);
        const all = sum([...shell, ...neededBy([page], chunks, true)]);
        said.push(`${page.name} ${before}, with all that it may show ${all}`);
        if (before > MOST_BYTES || all > MOST_BYTES_WITH_VIEWER) {
          this.error(`${said.at(-1)}; at most ${MOST_BYTES} and ${MOST_BYTES_WITH_VIEWER} are allowed.`);
        }
      }
      this.info(`${said.join(". ")}.`);
    },
  };
}

/** Names of the scripts and styles that some chunks need at once, or ever. */
function neededBy(some: Rolldown.OutputChunk[], chunks: Rolldown.OutputChunk[], ever = false): string[] {
  const needed = new Set(some);
  for (const chunk of needed) {
    const names = new Set([...chunk.imports, ...(ever && !chunk.isEntry ? chunk.dynamicImports : [])]);
    for (const next of chunks) if (names.has(next.fileName)) needed.add(next);
  }
  return [...needed].flatMap((chunk) => [chunk.fileName, ...(chunk.viteMetadata?.importedCss ?? [])]);
}

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
      : { outDir: OUT, emptyOutDir: true }),
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
