import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig } from "vite";

// `npm run dev` serves the pages with the API of a running `apexcal serve` behind them. The service checks Host and
// Origin of every unsafe request, so the proxy presents itself as the service's own address.
const service = process.env["APEXCAL_URL"] ?? "http://127.0.0.1:8000";

export default defineConfig({
  plugins: [svelte()],
  build: {
    outDir: "../service/web",
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
