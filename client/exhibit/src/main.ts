// The exhibit page. URL parameters: lang=de, level=1 (halves the volume's resolution), mark=X,Y (where the followed
// visitor stands), probe (access for tests).
import "./style.css";
import { App } from "./app";
import { readMark } from "./following";
import { readChampion, type Champion } from "./champions";
import { StreamKind } from "./gen/kinevox/web/v1/exhibit_pb";
import { Languages, type LanguageList, type Texts } from "./language";
import { Link } from "./link";
import { Scene, windowSize } from "./scene";

const POSES_HZ = 30,
  VOLUMES_HZ = 25;

async function json<T>(path: string): Promise<T> {
  const response = await fetch(new URL(path, document.baseURI));
  if (!response.ok) throw new Error(`${path}: ${response.status}`);
  return (await response.json()) as T;
}

async function readChampions(): Promise<Champion[]> {
  const champions: Champion[] = [];
  for (const id of await json<string[]>("champions/index.json"))
    try {
      champions.push(readChampion(id, await json(`champions/${id}.json`)));
    } catch (error) {
      console.error(String(error)); // the page works without it
    }
  if (champions.length === 0) throw new Error("champions/index.json lists no valid champion");
  return champions;
}

function languageButtons(languages: Languages, chosen: () => void): void {
  const nav = document.getElementById("languages")!;
  for (const [name, label] of Object.entries(languages.list.languages)) {
    const button = document.createElement("button");
    button.textContent = label;
    button.lang = name;
    button.addEventListener("click", () => void languages.choose(name).then(chosen));
    nav.append(button);
  }
}

function markLanguage(languages: Languages): void {
  for (const button of document.querySelectorAll<HTMLElement>("#languages button"))
    button.setAttribute("aria-pressed", String(button.lang === languages.chosen));
}

/** Centre of the area without panels and texts, as fractions of the window. */
function freeCentre(wide: boolean): readonly [number, number] {
  const attract = document.body.classList.contains("attract");
  if (wide) return attract ? [0.71, 0.54] : [0.5, 0.54];
  return attract ? [0.5, 0.4] : [0.5, 0.29];
}

/** Follows the size of the window at once and the free centre slowly. */
function fitter(scene: Scene): () => void {
  let fitted = -1,
    wide = true;
  let at: readonly [number, number] | undefined;
  return () => {
    if (fitted !== windowSize.changes) {
      fitted = windowSize.changes;
      wide = innerWidth > innerHeight;
      scene.resize(innerWidth, innerHeight);
      at = undefined;
    }
    const to = freeCentre(wide);
    if (at && Math.hypot(at[0] - to[0], at[1] - to[1]) < 1e-3) return;
    at = at ? [at[0] + 0.08 * (to[0] - at[0]), at[1] + 0.08 * (to[1] - at[1])] : to;
    scene.aim(...at);
  };
}

async function main(): Promise<void> {
  const parameters = new URLSearchParams(location.search);
  const list = await json<LanguageList>("languages/index.json");
  const languages = new Languages(list, (name) => json<Texts>(`languages/${name}.json`), parameters.get("lang"));
  await languages.choose(languages.chosen);
  const champions = await readChampions();
  const scene = new Scene(document.getElementById("scene") as HTMLCanvasElement);
  const clock = { now: () => performance.now() };
  const markText = parameters.get("mark");
  const mark = markText === null ? undefined : readMark(markText);
  if (markText !== null && !mark) console.error(`mark=${markText} in the URL is not X,Y in metres; the origin is used`);
  const app = new App(scene, languages, champions, () => clock.now(), mark);
  const translate = () => {
    app.translate();
    markLanguage(languages);
  };
  languageButtons(languages, translate);
  translate();

  const fit = fitter(scene);
  const address = new URL("ws", document.baseURI);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  address.search = "";
  const link = new Link(address.href, {
    message: (message) => app.message(message),
    connected: (isConnected) => app.connected(isConnected),
  });
  const downsampleLevel = Math.min(5, Math.max(0, Math.trunc(Number(parameters.get("level") ?? 0)) || 0));
  link.subscribe([
    { kind: StreamKind.POSES, maxRateHz: POSES_HZ },
    { kind: StreamKind.VOLUMES, downsampleLevel, maxRateHz: VOLUMES_HZ },
    { kind: StreamKind.STATUS },
  ]);

  let running = true;
  const frame = () => {
    if (!running) return;
    fit();
    app.frame(clock.now());
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
  if (parameters.has("probe")) {
    const { makeProbe } = await import("./probe");
    makeProbe({
      app,
      scene,
      link,
      fit,
      clock,
      setRunning: (on) => {
        if (on && !running) requestAnimationFrame(frame);
        running = on;
      },
    });
  }
}

// On a kiosk, a long touch or two fingers must not open menus or zoom the page.
for (const name of ["contextmenu", "gesturestart", "dragstart"])
  addEventListener(name, (event) => event.preventDefault());
/** Reloads the page once the gateway answers: a kiosk has no keyboard. */
async function reloadWhenAvailable(): Promise<void> {
  for (;;) {
    await new Promise((done) => setTimeout(done, 5_000));
    const response = await fetch(document.baseURI).catch(() => undefined);
    if (response?.ok) return location.reload();
  }
}

main().catch((error: unknown) => {
  console.error(error);
  void reloadWhenAvailable();
});
