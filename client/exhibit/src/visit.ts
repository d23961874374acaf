// Who stands there: attract mode, a visit, its best pose. In memory only, and gone with the visitor.
import { score, type Champion, type Score } from "./champions";
import type { Angles, Joints } from "./skeleton";

export interface Best {
  score: Score;
  joints: Joints;
}

const GONE_AFTER_MS = 4_000; // without a body: somebody bent down, or walked through a corner
const NOT_NOW_MS = 500;
const HERE_AFTER_MS = 600;

export class Visit {
  present = false;
  now: Score | undefined; // against the champion chosen; undefined: not seen well enough
  best: Best | undefined;
  number = 0; // of the visit, for who draws
  private seenAt = -Infinity;
  private firstSeenAt: number | undefined;
  private subject = 0;
  private bests = new Map<string, Best>();

  constructor(public champion: Champion) {}

  choose(champion: Champion): void {
    this.champion = champion;
    this.now = undefined;
    this.best = this.bests.get(champion.id);
  }

  /** What was measured of somebody; `subject` 0: nobody is there. */
  saw(subject: number, joints: Joints, angles: Angles, now_ms: number): void {
    if (subject === 0) return this.passed(now_ms);
    if (this.present && subject !== this.subject) this.forget();
    this.subject = subject;
    this.seenAt = now_ms;
    this.firstSeenAt ??= now_ms;
    if (!this.present && now_ms - this.firstSeenAt >= HERE_AFTER_MS) this.present = true;
    if (!this.present) return;
    this.now = score(angles, this.champion);
    if (this.now && (!this.best || this.now.percent > this.best.score.percent)) {
      this.best = { score: this.now, joints };
      this.bests.set(this.champion.id, this.best);
    }
  }

  /** Time went by without a body. */
  passed(now_ms: number): void {
    if (now_ms - this.seenAt > NOT_NOW_MS) this.now = undefined;
    if (now_ms - this.seenAt <= GONE_AFTER_MS) return;
    if (this.present || this.firstSeenAt !== undefined) this.leave();
  }

  private leave(): void {
    this.present = false;
    this.firstSeenAt = undefined;
    this.forget();
  }

  private forget(): void {
    this.number += 1;
    this.now = this.best = undefined;
    this.bests.clear();
  }
}
