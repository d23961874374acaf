// For tests and benchmarks: exposes the state of the page and feeds it faster than real time. Loaded by ?probe only.
import type { App } from "./app";
import type { Link } from "./link";
import type { Scene } from "./scene";

interface Parts {
  app: App;
  scene: Scene;
  link: Link;
  fit: () => void;
  clock: { now: () => number };
  setRunning: (on: boolean) => void;
}

export function makeProbe({ app, scene, link, fit, clock, setRunning }: Parts): void {
  const stats = () => {
    const memory = (performance as unknown as { memory?: { usedJSHeapSize: number } }).memory;
    return {
      ...app.state,
      geometries: scene.renderer.info.memory.geometries,
      textures: scene.renderer.info.memory.textures,
      programs: scene.renderer.info.programs?.length ?? 0,
      nodes: document.getElementsByTagName("*").length,
      heap_bytes: memory?.usedJSHeapSize ?? 0,
    };
  };
  const probe = {
    stats,
    subscribe: (kind: number, camera = "") => link.subscribe([{ kind, camera }]),
    messages: [] as Uint8Array[], // GatewayMessages for run(), set by the test
    /** Feeds `count` of the messages in order, `every_ms` of page time apart. Each is processed up to the scene; every
     *  `draw_every`-th frame is drawn. */
    run(first: number, count: number, every_ms: number, draw_every: number, start_ms: number) {
      setRunning(false);
      fit();
      const draw = scene.draw;
      try {
        for (let n = first; n < first + count; ++n) {
          clock.now = () => start_ms + n * every_ms;
          link.receive(probe.messages[n % probe.messages.length]!);
          if (n % draw_every !== 0) scene.draw = () => undefined;
          app.frame(clock.now());
          scene.draw = draw;
        }
      } finally {
        scene.draw = draw;
      }
      return stats();
    },
  };
  (window as unknown as { kinevox: typeof probe }).kinevox = probe;
}
