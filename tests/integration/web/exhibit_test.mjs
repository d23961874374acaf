// The exhibit page in headless Chromium with a real daemon and gateway.
//
// usage: exhibit_test.mjs BUILD-FOLDER [--images FOLDER]
import assert from "node:assert/strict";
import { execFile, spawnSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import {
  cleanUp,
  openBrowser,
  REPOSITORY,
  skipWithoutChromium,
  start,
  startDaemon,
  temporary,
  testData,
  until,
} from "../../support/exhibit_browser.mjs";

skipWithoutChromium();
const BUILD = process.argv[2];
const IMAGES = process.argv[3] === "--images" ? process.argv[4] : undefined;
const WEB = join(BUILD, "client/web/kinevox-web"),
  DAEMON = join(BUILD, "server/daemon/kinevoxd"),
  CLI = join(BUILD, "client/cli/kinevox"),
  STUDIO = join(BUILD, "server/tools/kinevox-studio");
const PAGES = join(BUILD, "client/exhibit/page");
const IMAGE = 5; // StreamKind of exhibit.proto

const portOf = (program) => Number(program.address.split(":").pop());
const kinevox = async (...words) => {
  return new Promise((done) => execFile(CLI, words, (error) => done(error === null)));
};

let daemon = await startDaemon(DAEMON);
let web = await start(WEB, "--server", daemon.address, "--listen", "127.0.0.1:0", "--page-dir", PAGES);
const browser = await openBrowser();
const context = await browser.newContext({ viewport: { width: 960, height: 540 }, hasTouch: true });
const page = await context.newPage();
const errors = [],
  otherHosts = [];
page.on("pageerror", (error) => errors.push(error.message));
page.on("console", (message) => {
  // Expected while the gateway is restarted.
  if (message.type() === "error" && !/WebSocket connection/.test(message.text())) errors.push(message.text());
});
const origin = `http://${web.address}`;
page.on("request", (request) => {
  if (!request.url().startsWith(origin)) otherHosts.push(request.url());
});
const stats = () => page.evaluate(() => globalThis.kinevox?.stats());
const banner = () =>
  page.evaluate(() =>
    document.getElementById("banner").hidden ? "" : document.getElementById("banner-text").textContent,
  );
const attract = () => page.evaluate(() => document.body.classList.contains("attract"));

/** Counts pixels of the screenshot by colour, in a page of its own. */
const reader = await browser.newPage();
async function pixels(clip, name) {
  const options = { type: "png", ...(clip ? { clip } : {}) };
  const shot = await page.screenshot(options);
  if (IMAGES && name) await page.screenshot({ path: join(IMAGES, `${name}.png`) });
  return reader.evaluate(async (data) => {
    const image = new Image();
    image.src = `data:image/png;base64,${data}`;
    await image.decode();
    const canvas = document.createElement("canvas");
    ((canvas.width = image.width), (canvas.height = image.height));
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    const { data: rgba } = context.getImageData(0, 0, canvas.width, canvas.height);
    const out = { left: 0, right: 0, lit: 0, all: rgba.length / 4 };
    for (let n = 0; n < rgba.length; n += 4) {
      const [r, g, b] = [rgba[n], rgba[n + 1], rgba[n + 2]];
      if (b > 110 && b > 1.35 * g && b > 1.8 * r) ++out.left;
      if (r > 110 && r > 1.35 * g && g > 1.8 * b) ++out.right;
      if (r + g + b > 150) ++out.lit;
    }
    return out;
  }, shot.toString("base64"));
}
// Of client/exhibit/src/palette.ts.
const OUTLINE = { inner: [0x1a, 0x20, 0x2a], rim: [0xa3, 0xb0, 0xc6] };
/** Sizes in pixels of the outlines, behind the panels, too: connected pixels between the colours of body and rim. */
async function outlines() {
  const hidePanels = (hide) =>
    page.evaluate((visibility) => {
      for (const panel of document.querySelectorAll("body > :not(#scene)")) panel.style.visibility = visibility;
    }, hide && "hidden");
  await hidePanels(true);
  const shot = await page.screenshot();
  await hidePanels("");
  return reader.evaluate(
    async ([data, { inner, rim }, minPixels]) => {
      const image = new Image();
      image.src = `data:image/png;base64,${data}`;
      await image.decode();
      const { width, height } = image;
      const context = new OffscreenCanvas(width, height).getContext("2d");
      context.drawImage(image, 0, 0);
      const { data: rgba } = context.getImageData(0, 0, width, height);
      const isOutline = new Uint8Array(width * height).map((_, n) => {
        const t = (rgba[4 * n] - inner[0]) / (rim[0] - inner[0]);
        const misses = (c) => Math.abs(rgba[4 * n + c] - inner[c] - t * (rim[c] - inner[c])) > 3;
        return t > -0.03 && t < 1.03 && !misses(1) && !misses(2);
      });
      // The floor's lines have such colours, too, but are narrow.
      const around = [-1, 0, 1].flatMap((right) => [-width, 0, width].map((down) => right + down));
      const left = new Set();
      isOutline.forEach((is, n) => is && around.every((step) => isOutline[n + step]) && left.add(n));
      const sizes = [];
      for (const seed of left) {
        const connected = [seed];
        left.delete(seed);
        for (const n of connected) for (const step of around) if (left.delete(n + step)) connected.push(n + step);
        if (connected.length >= minPixels) sizes.push(connected.length);
      }
      return sizes;
    },
    [shot.toString("base64"), OUTLINE, 400],
  );
}
const CENTRE = { x: 300, y: 60, width: 360, height: 420 }; // between the panels

const steps = {
  "reports a wrong option in one line"() {
    const wrong = [
      [["--page-dir", "/nowhere"], /no folder \/nowhere; .*--page-dir/],
      [["--page-dir", PAGES, "--listen", "nowhere"], /not HOST:PORT/],
      [["--page-dir", PAGES, "--listen", web.address], /cannot listen on .*--listen/],
      [["--ca", "/nowhere.pem"], /nowhere\.pem/],
      [["--images"], /--images/],
    ];
    for (const [options, words] of wrong) {
      const ran = spawnSync(WEB, options, { encoding: "utf8", timeout: 20_000 });
      assert.equal(ran.status === 0, false);
      assert.match(ran.stderr, words);
      assert.equal(ran.stderr.split("\n").length, 2, ran.stderr);
    }
  },

  async "connects and draws volume and skeleton"() {
    await page.goto(`${origin}/?probe&level=1&lang=en`);
    await until("a visitor and some volumes", async () => {
      const s = await stats();
      return s?.present && s.volumes > 4 && s.joints > 15;
    });
    await until("the panels", async () => !(await attract()));
    await until("the body in the centre", async () => {
      const seen = await pixels(CENTRE, "visitor");
      return seen.left > 150 && seen.right > 150 && seen.lit > 4000;
    });
    const s = await stats();
    assert.equal(s.problem, "");
    assert.equal(s.damaged, 0);
    assert.match(await page.textContent("#angle-knee_flexion_geometric_l"), /^−?\d+°$/);
    assert.match(await page.textContent("#volume-note"), /\d+ litres/);
  },

  async "compares with a champion chosen by touch"() {
    await until("a score", async () => (await stats()).best > 0);
    const name = await page.textContent("#champion-name");
    await page.tap("#champions button:nth-child(3)");
    await until("another champion", async () => (await page.textContent("#champion-name")) !== name);
    await until("a score against it", async () => /^\d+ %$/.test(await page.textContent("#score-best")));
    const duel = await page.locator("#duel").boundingBox();
    const half = { x: duel.x + duel.width / 2, y: duel.y, width: duel.width / 2, height: duel.height };
    for (const [side, clip] of [
      ["the visitor's figure", { ...half, x: duel.x }],
      ["the champion's figure", half],
    ])
      // The figures are drawn one frame after the score.
      await until(side, async () => {
        const seen = await pixels(clip);
        return seen.left > 20 && seen.right > 20;
      });
  },

  async "shows the languages of its files"() {
    for (const [button, lang, words] of [
      ["Deutsch", "de", "Deine Gelenke"],
      ["Français", "fr", "Tes articulations"],
      ["English", "en", "Your joints"],
    ]) {
      await page.tap(`#languages button:text-is("${button}")`);
      await until(words, async () => (await page.textContent("#angles h2")) === words);
      assert.equal(await page.getAttribute("html", "lang"), lang);
    }
    const other = await context.newPage();
    await other.goto(`${origin}/?lang=de`);
    await until(
      "German by the URL",
      async () => (await other.textContent("#invitation h1")) === "Tritt in den Raum",
    );
    await other.close();
  },

  async "gets no images"() {
    await page.evaluate((kind) => globalThis.kinevox.subscribe(kind, "cam1"), IMAGE);
    const error = await until("an error", async () => (await stats()).errors[0]);
    assert.match(error, /^PERMISSION_DENIED: camera images are never sent/);
    await page.reload();
    // Attract mode ends with the next frame.
    await until("a visitor again", async () => (await stats())?.present && !(await attract()));
  },

  async "shows attract mode and the state of a stopped capture"() {
    assert.ok(await kinevox("stop", "--server", daemon.address));
    await until("attract mode", attract);
    await until("the capture's state", async () => (await banner()) === "The capture is stopped.");
    assert.equal((await stats()).best, undefined, "the visit is discarded");
    assert.match(await page.textContent("#angle-knee_flexion_geometric_l"), /^–$/);
    await until("a champion's figure", async () => {
      const seen = await pixels({ x: 480, y: 60, width: 480, height: 440 }, "attract");
      return seen.left > 150 && seen.right > 150;
    });
    assert.ok(await kinevox("start", "--server", daemon.address));
    await until("a visitor", async () => (await stats()).present && !(await attract()));
    await until("no banner", async () => (await banner()) === "");
  },

  async "survives a restart of the gateway"() {
    const port = portOf(web),
      before = await stats();
    assert.equal(await web.end(), 0, "SIGTERM ends it cleanly");
    await until("the banner", async () => (await banner()).startsWith("Connection lost"));
    web = await start(WEB, "--server", daemon.address, "--listen", `127.0.0.1:${port}`, "--page-dir", PAGES);
    await until("more volumes", async () => (await stats()).volumes > before.volumes + 3);
    assert.equal((await stats()).connections, before.connections + 1);
    await until("no banner", async () => (await banner()) === "");
  },

  async "survives a daemon that is killed"() {
    const port = portOf(daemon),
      before = await stats();
    await daemon.end("SIGKILL");
    await until("the banner", async () => (await banner()).startsWith("The capture does not answer"));
    await until("attract mode", attract);
    daemon = await startDaemon(DAEMON, { port });
    await until("more volumes", async () => (await stats()).volumes > before.volumes + 3);
    await until("a visitor", async () => (await stats()).present && (await banner()) === "");
    assert.equal((await stats()).connections, before.connections, "the gateway stayed connected");
  },

  async "follows the visitor nearest to the mark, with the other as an outline"() {
    const session = testData("studio/pair/session.toml");
    if (!session) return console.log("skipped: no test data");
    const port = portOf(daemon);
    await daemon.end();
    daemon = await startDaemon(DAEMON, { port, session, maxSubjects: 2 });
    // One of the two walks from y = 0 to 1.2 m, the other stays at y < -0.4 m.
    for (const y of [3, -3]) {
      await page.goto(`${origin}/?probe&level=1&lang=en&mark=0,${y}`);
      await until("a visitor and another one", async () => {
        const s = await stats();
        return s?.present && s.others === 1 && s.joints > 15;
      });
      await until("the visitor at the side of the mark", async () => {
        return (await stats()).at[1] > -0.3 === y > 0;
      });
    }
    await until("the body in the centre", async () => {
      const seen = await pixels(CENTRE, "two_visitors");
      return seen.left > 150 && seen.right > 150;
    });
  },

  async "shows no, one, two and four visitors, who enter one after another"() {
    const scene = join(REPOSITORY, "tests/support/four_people.toml"),
      folder = join(temporary, "four");
    const rendered = spawnSync(STUDIO, ["--scene", scene, "--out", folder, "--no-masks"], { encoding: "utf8" });
    assert.equal(rendered.status, 0, rendered.stderr);
    const positions = [...readFileSync(scene, "utf8").matchAll(/shift_m = \[(.*), (.*)\]/g)].map(([, x, y]) => [+x, +y]);
    const follows = ({ at: [x, y] }, position) => Math.hypot(x - position[0], y - position[1]) < 0.6;
    // A busy machine may miss what is shown for a second, until the session begins again.
    const untilShown = (what, check) => until(what, check, 80);
    const port = portOf(daemon);
    await daemon.end();
    daemon = await startDaemon(DAEMON, { port, session: join(folder, "session.toml"), maxSubjects: 4 });

    // The last one to enter is nearest to the mark.
    await page.goto(`${origin}/?probe&level=1&lang=en&mark=${positions[3]}`);
    await untilShown("no visitor", async () => {
      const s = await stats();
      return s?.poses > 2 && s.joints === 0 && s.others === 0 && (await attract());
    });
    await pixels(undefined, "no_visitor");
    // From above none is hidden by another one. A view that was touched does not rotate.
    await page.mouse.move(480, 200);
    await page.mouse.down();
    await page.mouse.move(480, 270, { steps: 5 });
    await page.mouse.up();
    await page.mouse.wheel(0, 2000);
    await untilShown("one visitor without an outline", async () => {
      const before = await stats(),
        drawn = await outlines(),
        after = await stats();
      const isAlone = (s) => s.others === 0 && s.joints > 15 && follows(s, positions[0]);
      return isAlone(before) && isAlone(after) && after.present && !(await attract()) && drawn.length === 0;
    });
    await untilShown("two visitors", async () => {
      const s = await stats();
      return s.others === 1 && follows(s, positions[0]);
    });
    await untilShown("an outline", async () => (await outlines()).length === 1);
    await untilShown("four visitors", async () => {
      const s = await stats();
      return s.present && s.others === 3 && s.joints > 15 && follows(s, positions[3]);
    });
    await untilShown("three outlines", async () => (await outlines()).length === 3);
    await pixels(undefined, "four_visitors");
    await untilShown("attract mode when all have left", async () => (await attract()) && (await stats()).others === 0);

    await page.goto(`${origin}/?probe&level=1&lang=en&mark=${positions[1]}`);
    await untilShown("another one followed", async () => {
      const s = await stats();
      return s?.present && s.others === 3 && s.joints > 15 && follows(s, positions[1]);
    });
    assert.equal((await stats()).problem, "");
    assert.deepEqual(errors, []);
  },

  async "stores nothing and connects to no other host"() {
    const kept = await page.evaluate(async () => ({
      storage: localStorage.length + sessionStorage.length,
      cookies: document.cookie,
      databases: (await indexedDB.databases()).length,
      caches: (await caches.keys()).length,
    }));
    assert.deepEqual(kept, { storage: 0, cookies: "", databases: 0, caches: 0 });
    assert.deepEqual(otherHosts, []);
    assert.deepEqual(errors, []);
  },
};

let failed = 0;
for (const [name, step] of Object.entries(steps)) {
  const begin = Date.now();
  try {
    await step();
    console.log(`ok: ${name} (${((Date.now() - begin) / 1000).toFixed(1)} s)`);
  } catch (error) {
    failed = 1;
    console.log(
      `FAILED: ${name}\n${error.stack}\n${JSON.stringify(await stats().catch(() => "no page"))}\n${errors.join("\n")}`,
    );
    break; // later steps depend on it
  }
}
await browser.close();
await web.end();
await daemon.end();
await cleanUp();
process.exit(failed);
