// The current visit and its best pose. Kept in memory only and discarded when the visitor leaves.
import { score, type Champion, type Score } from "./champions";
import type { Angles, Joints } from "./skeleton";

export interface Best {
  score: Score;
  joints: Joints;
}

const LEAVE_AFTER_MS = 4_000; // without a body; shorter gaps occur when a visitor bends down
const SCORE_TIMEOUT_MS = 500;
const ARRIVE_AFTER_MS = 600;

export class Visit {
  present = false;
  now: Score | undefined; // against the chosen champion; undefined: too many angles withheld
  best: Best | undefined;
  number = 0; // of the visit; changes with each visitor
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

  /** Takes a measured pose; `subject` 0: no subject. */
  update(subject: number, joints: Joints, angles: Angles, now_ms: number): void {
    if (subject === 0) return this.advance(now_ms);
    if (this.present && subject !== this.subject) this.forget();
    this.subject = subject;
    this.seenAt = now_ms;
    this.firstSeenAt ??= now_ms;
    if (!this.present && now_ms - this.firstSeenAt >= ARRIVE_AFTER_MS) this.present = true;
    if (!this.present) return;
    this.now = score(angles, this.champion);
    if (this.now && (!this.best || this.now.percent > this.best.score.percent)) {
      this.best = { score: this.now, joints };
      this.bests.set(this.champion.id, this.best);
    }
  }

  /** Takes the time without a new pose. */
  advance(now_ms: number): void {
    if (now_ms - this.seenAt > SCORE_TIMEOUT_MS) this.now = undefined;
    if (now_ms - this.seenAt <= LEAVE_AFTER_MS) return;
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
