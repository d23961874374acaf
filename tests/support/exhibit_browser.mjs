// The exhibit's programs and a browser before them, for tests and benchmarks.
import { spawn } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { createInterface } from "node:readline";
import { fileURLToPath } from "node:url";

export const REPOSITORY = join(dirname(fileURLToPath(import.meta.url)), "../..");
const { chromium } = createRequire(join(REPOSITORY, "client/exhibit/package.json"))("playwright-core");
const CHROMIUM = "/usr/bin/chromium";
export const SKIPPED = 77;

export function skipWithoutChromium() {
  if (existsSync(CHROMIUM)) return;
  console.log(`skipped: ${CHROMIUM} is not there; deploy/install-deps installs it`);
  process.exit(SKIPPED);
}

/** A file of the shared test data (tests/support/test_data.h); undefined where it is not. */
export function testData(name) {
  const file = join(process.env.KINEVOX_TEST_DATA ?? join(REPOSITORY, "../shared/data"), name);
  return existsSync(file) ? file : undefined;
}

export const temporary = mkdtempSync(join(tmpdir(), "kinevox-exhibit-"));
const running = new Set();

/** A program that prints "ready on ADDRESS" first. */
export async function start(program, ...options) {
  const child = spawn(program, options, { stdio: ["ignore", "pipe", "ignore"] });
  running.add(child);
  const lines = createInterface(child.stdout);
  const started = { child, line: "", address: "" };
  await new Promise((ready, failed) => {
    lines.on("line", (line) => {
      started.line = line;
      if (!line.startsWith("ready on ")) return;
      started.address = line.slice("ready on ".length).trim();
      ready();
    });
    child.once("exit", (status) => failed(new Error(`${program} ended with ${status} before it was ready`)));
    child.once("error", failed);
  });
  started.end = (signal = "SIGTERM") =>
    new Promise((ended) => {
      running.delete(child);
      child.once("exit", (status, by) => ended(status ?? by));
      if (!child.kill(signal)) ended(child.exitCode ?? child.signalCode);
    });
  started.residentMb = () => residentMb(child.pid);
  return started;
}

export function residentMb(pid) {
  try {
    return Number(/VmRSS:\s+(\d+)/.exec(readFileSync(`/proc/${pid}/status`, "utf8"))[1]) / 1024;
  } catch {
    return 0; // ended
  }
}

/** A daemon on a small virtual studio, or on the people of a session. */
export function startDaemon(program, { motion = "arm_raise", port = 0, fps = 5, session, maxSubjects = 1 } = {}) {
  const config = join(temporary, `kinevoxd-${session ? "session" : motion}-${port}.toml`);
  const source = session
    ? `[source]\nkind = "session"\nsession_file = "${session}"\npacing = "real_time"\nloop = true\n`
    : `[source]\nkind = "studio"\n[source.studio]\n` +
      `motion = "${motion}"\nwidth_px = 240\nheight_px = 180\nfps = ${fps.toFixed(1)}\n`;
  writeFileSync(
    config,
    `[server]\nlisten = "127.0.0.1:${port}"\n${source}[tracking]\nmax_subjects = ${maxSubjects}\n` +
      `[pose]\ndatabase_file = ""\nauto_fit_body = false\n[calibration]\nfolder = ""\n[recording]\nfolder = ""\n[log]\nlevel = "error"\n`,
  );
  return start(program, "--config", config);
}

export async function openBrowser() {
  return chromium.launch({
    executablePath: CHROMIUM,
    args: [
      "--headless",
      "--no-sandbox",
      "--use-gl=angle",
      "--use-angle=swiftshader",
      "--enable-unsafe-swiftshader",
      "--disable-quic",
      "--no-first-run",
      "--disable-background-networking",
      "--disable-component-update",
      "--disable-sync",
    ],
  });
}

/** Waits until `check()` yields something true, and returns it. */
export async function until(what, check, limit_s = 40) {
  const end = Date.now() + 1000 * limit_s;
  for (;;) {
    const value = await check();
    if (value) return value;
    if (Date.now() > end) throw new Error(`not within ${limit_s} s: ${what}`);
    await new Promise((done) => setTimeout(done, 50));
  }
}

export async function cleanUp() {
  for (const child of running) child.kill("SIGKILL");
  rmSync(temporary, { recursive: true, force: true });
}
