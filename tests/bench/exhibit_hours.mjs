// Eight hours of an exhibit at high speed: growth of memory, GPU objects and DOM.
//
// usage: exhibit_hours.mjs BUILD-FOLDER [--hours 8] [--draw-every 25] [--results FOLDER]
//
// Visitors come and go in cycles of one minute (tests/support/scripted_daemon.cc): 25 poses and 25 volumes (40 mm) per
// second. Two parts, each over the whole time:
//   page     every pose and volume passes through the page's code, from the bytes of the socket to the scene and the
//            panels; the page's clock advances by 40 ms per pair. Every --draw-every-th image is painted, because
//            software OpenGL is slow.
//   gateway  the scripted daemon sends the same number over gRPC, at most 2000 per second; kinevox-web forwards the
//            latest to the page, which subscribes to 30 poses and 25 volumes per second.
// Measured after garbage collection: after a twentieth of the time, when the first page has run the script once, and at
// the end. Exits with 1 if a bound is not met.
import { readFileSync, writeFileSync } from "node:fs";
import { cpus, loadavg } from "node:os";
import { join } from "node:path";
import { spawnSync } from "node:child_process";
import {
  cleanUp,
  openBrowser,
  REPOSITORY,
  residentMb,
  skipWithoutChromium,
  start,
  temporary,
  until,
} from "../support/exhibit_browser.mjs";

const BUILD = process.argv[2];
const option = (name, otherwise) => {
  const at = process.argv.indexOf(`--${name}`);
  return at < 0 ? otherwise : process.argv[at + 1];
};
const HOURS = Number(option("hours", "8")),
  DRAW_EVERY = Number(option("draw-every", "25"));
const RESULTS = option("results", "");
const FRAMES = Math.round(HOURS * 3600 * 25),
  CHUNKS = 20;
const CYCLE = 1500; // frames of the script, after which the script repeats
const WARM = Math.max(1, Math.ceil((1.2 * CYCLE * CHUNKS) / FRAMES)); // chunks before the first measurement
const MOST_HEAP_MB = 2,
  MOST_PROCESS_MB = 40,
  MOST_GATEWAY_MB = 2;

skipWithoutChromium();
const script = join(BUILD, "tests/scripted_daemon");
const browser = await openBrowser();

function cycle() {
  const file = join(temporary, "cycle.bin");
  if (spawnSync(script, ["--write", file]).status !== 0) throw new Error(`${script} failed`);
  const bytes = readFileSync(file),
    messages = [];
  for (let at = 0; at < bytes.length;) {
    const length = bytes.readUInt32LE(at);
    messages.push(bytes.subarray(at + 4, at + 4 + length).toString("base64"));
    at += 4 + length;
  }
  return messages;
}

async function open(web) {
  const page = await browser.newPage({ viewport: { width: 640, height: 400 } });
  page.on("pageerror", (error) => {
    throw error;
  });
  await page.goto(`http://${web.address}/?probe&level=0`);
  await page.waitForFunction(() => globalThis.kinevox);
  return page;
}

async function measured(page) {
  const session = await page.context().newCDPSession(page);
  for (let n = 0; n < 3; ++n) await session.send("HeapProfiler.collectGarbage");
  const { usedSize } = await session.send("Runtime.getHeapUsage");
  const counters = await session.send("Memory.getDOMCounters");
  await session.detach();
  const whole = await browser.newBrowserCDPSession();
  const { processInfo } = await whole.send("SystemInfo.getProcessInfo");
  await whole.detach();
  const stats = await page.evaluate(() => globalThis.kinevox.stats());
  const rss = (type) => processInfo.filter((p) => p.type === type).reduce((sum, p) => sum + residentMb(p.id), 0);
  return {
    ...stats,
    heap_mb: usedSize / 2 ** 20,
    dom_nodes: counters.nodes,
    listeners: counters.jsEventListeners,
    renderer_mb: rss("renderer"),
    gpu_mb: rss("GPU"),
  };
}

const rows = [];
const row = (part, what, first, last, most) => rows.push({ part, what, first, last, most, kept: last - first <= most });
const idle = await start(script, "--frames", "0");

// The page. Its gateway is connected to an idle daemon.
let web = await start(
  join(BUILD, "client/web/kinevox-web"),
  "--server",
  idle.address,
  "--listen",
  "127.0.0.1:0",
  "--page-dir",
  join(BUILD, "client/exhibit/page"),
);
let page = await open(web);
await page.evaluate((messages) => {
  globalThis.kinevox.messages = messages.map((text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
}, cycle());
const begin = Date.now(),
  start_ms = await page.evaluate(() => performance.now());
const heaps = [],
  seen_late = []; // the last quarter
let first;
for (let chunk = 0; chunk < CHUNKS; ++chunk) {
  const count = Math.round((2 * FRAMES) / CHUNKS);
  await page.evaluate(
    ([from, n, every, at]) => globalThis.kinevox.run(from, n, 20, 2 * every, at),
    [chunk * count, count, DRAW_EVERY, start_ms],
  );
  const now = await measured(page);
  heaps.push(now.heap_mb.toFixed(2));
  if (process.stderr.isTTY) process.stderr.write(`\r${chunk + 1} of ${CHUNKS}`);
  if (chunk === WARM - 1) first = now;
  if (chunk >= 0.75 * CHUNKS) seen_late.push(now);
  if (chunk === CHUNKS - 1) {
    row("page", "JavaScript heap, MB", first.heap_mb, now.heap_mb, MOST_HEAP_MB);
    row("page", "geometries on the GPU", first.geometries, now.geometries, 0);
    row("page", "textures on the GPU", first.textures, now.textures, 0);
    row("page", "programs on the GPU", first.programs, now.programs, 0);
    // The browser counts replaced texts until it collects them, which three requests do not always cause.
    const least = (what) => Math.min(...seen_late.map((at) => at[what]));
    row("page", "DOM nodes", first.dom_nodes, least("dom_nodes"), 0);
    row("page", "event listeners", first.listeners, least("listeners"), 0);
    row("page", "renderer process, MB", first.renderer_mb, now.renderer_mb, MOST_PROCESS_MB);
    row("page", "GPU process, MB", first.gpu_mb, now.gpu_mb, MOST_PROCESS_MB);
    rows.page = {
      seconds: (Date.now() - begin) / 1000,
      poses: now.poses,
      volumes: now.volumes,
      visits: now.visit,
      damaged: now.damaged,
    };
  }
}
await page.close();
await web.end();

// The gateway.
const daemon = await start(script, "--frames", String(FRAMES));
web = await start(
  join(BUILD, "client/web/kinevox-web"),
  "--server",
  daemon.address,
  "--listen",
  "127.0.0.1:0",
  "--page-dir",
  join(BUILD, "client/exhibit/page"),
);
const began = Date.now();
page = await open(web);
const sent = () => Math.min(...daemon.line.split(" ").map(Number));
await until("the first measurement", () => sent() >= (FRAMES * WARM) / CHUNKS, 3600);
const gateway = web.residentMb(),
  shown = await measured(page);
await until("all of it", () => sent() >= FRAMES, 7200);
const after = await measured(page);
row("gateway", "kinevox-web, MB", gateway, web.residentMb(), MOST_GATEWAY_MB);
row("gateway", "the page's heap, MB", shown.heap_mb, after.heap_mb, MOST_HEAP_MB);
// Compared with the first page's: this page may not have drawn anything at its first measurement. It skips messages, so the
// volume of the next visitor may come before the pose and be an outline, which it keeps for others: one geometry more.
row("gateway", "geometries on the GPU", first.geometries, after.geometries, 1);
rows.gateway = { seconds: (Date.now() - began) / 1000, poses: after.poses, volumes: after.volumes };
await browser.close();
for (const program of [web, daemon, idle]) await program.end();
await cleanUp();

const round = (value) => (Number.isInteger(value) ? String(value) : value.toFixed(1));
const { page: fed, gateway: passed } = rows;
const table = rows.map((r) =>
  [r.part, r.what, round(r.first), round(r.last), r.most, r.kept ? "yes" : "**no**"].join(" | "),
);
const text = `Exhibit: \`tests/bench/exhibit_hours.mjs build/release --hours ${HOURS} --draw-every ${DRAW_EVERY}\`: ${HOURS} hours
of visitors, ${FRAMES} poses and ${FRAMES} volumes, simulated; software OpenGL, ${cpus().length} cores, load at the end
${loadavg()[0].toFixed(1)}. "First" is measured after a twentieth of the time; the gateway's geometries are counted from the page's. "Last" is the minimum of the last quarter
for nodes and listeners, which the browser counts until it collects them.

Page: ${fed.poses} poses, ${fed.volumes} volumes decoded and prepared for drawing (the others have no subject), ${fed.visits} visits
discarded, in ${fed.seconds.toFixed(0)} s. Gateway: all messages read over gRPC in ${passed.seconds.toFixed(0)} s; the page,
which subscribes to 30 and 25 per second, received ${passed.poses} poses and drew ${passed.volumes} of these volumes.

| part | quantity | first | last | max growth | met |
| --- | --- | ---: | ---: | ---: | --- |
${table.map((line) => `| ${line} |\n`).join("")}`;
console.log(text);
console.log(`heap after each twentieth, MB: ${heaps.join(" ")}`);
if (RESULTS) writeFileSync(join(REPOSITORY, RESULTS, "exhibit.md"), text);
const seen =
  rows.page.poses >= 0.99 * FRAMES && rows.page.damaged === 0 && rows.page.visits >= Math.floor(HOURS * 60) - 1;
if (!seen) console.log(`not all messages were processed: ${JSON.stringify(rows.page)}`);
process.exit(seen && rows.every((r) => r.kept) ? 0 : 1);
