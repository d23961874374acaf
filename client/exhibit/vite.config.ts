import { defineConfig } from "vite";

// Everything is bundled: the page needs nothing but the gateway it came from.
export default defineConfig({
  base: "./",
  build: {
    outDir: process.env.KINEVOX_PAGE_DIR ?? "dist",
    emptyOutDir: true,
    target: "es2022",
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1000,
  },
  server: { proxy: { "/ws": { target: "ws://127.0.0.1:8090", ws: true } } },
  cacheDir: process.env.KINEVOX_VITE_CACHE ?? "node_modules/.vite",
});
