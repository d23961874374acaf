// The chosen champion, the visitor's score, and both figures.
import type { Champion } from "./champions";
import { Duel } from "./duel";
import type { Languages } from "./language";
import { windowSize } from "./scene";
import type { Visit } from "./visit";

const byId = (id: string) => document.getElementById(id)!;

export class ChampionPanel {
  private readonly duel = new Duel(byId("duel") as HTMLCanvasElement);
  private readonly buttons = new Map<string, HTMLButtonElement>();
  private shown = "";
  private drawn = "";

  constructor(
    private readonly champions: readonly Champion[],
    choose: (champion: Champion) => void,
  ) {
    for (const champion of champions) {
      const button = document.createElement("button");
      button.addEventListener("click", () => choose(champion));
      this.buttons.set(champion.id, button);
      byId("champions").append(button);
    }
  }

  translate(languages: Languages, visit: Visit): void {
    for (const champion of this.champions) this.buttons.get(champion.id)!.textContent = languages.of(champion.name);
    byId("champion-name").textContent = byId("duel-name").textContent = languages.of(visit.champion.name);
    byId("champion-about").textContent = languages.of(visit.champion.about);
    for (const [id, button] of this.buttons) button.setAttribute("aria-pressed", String(id === visit.champion.id));
    this.shown = this.drawn = "";
  }

  show(visit: Visit): void {
    const now = visit.now?.percent,
      best = visit.best?.score.percent;
    this.showNumbers(now, best);
    // The figures change only with the champion, a better pose, or the size of the canvas.
    const state = `${visit.champion.id} ${visit.number} ${best} ${windowSize.changes}`;
    if (state === this.drawn) return;
    if (this.duel.draw(visit.best?.joints, visit.champion.joints, visit.best?.score.mirrored ?? false))
      this.drawn = state;
  }

  private showNumbers(now: number | undefined, best: number | undefined): void {
    const numbers = `${now} ${best}`;
    if (numbers === this.shown) return;
    this.shown = numbers;
    byId("score-now").textContent = now === undefined ? "–" : String(now);
    byId("score-best").textContent = best === undefined ? "–" : `${best} %`;
    byId("ring-now").style.strokeDasharray = `${now ?? 0} 100`;
    byId("ring-best").style.strokeDasharray = `${best ?? 0} 100`;
    byId("ring-now").style.opacity = now ? "1" : "0"; // hides the round line cap at 0
    byId("ring-best").style.opacity = best ? "1" : "0";
  }
}
