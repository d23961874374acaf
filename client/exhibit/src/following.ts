// Which of several subjects the page follows: the one nearest to the mark on the floor.
import type { Vec3 } from "./skeleton";

/** World frame, metres. */
export type Mark = readonly [number, number];

// Another one must be nearer by this much for this time: two side by side do not alternate.
const NEARER_M = 0.4;
const NEARER_FOR_MS = 1_000;
const LOST_FOR_MS = 1_500; // then the next one is followed

/** Reads `X,Y` in metres; undefined if it is not that. */
export function readMark(text: string): Mark | undefined {
  const numbers = text.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  const [x, y] = numbers;
  return numbers.length === 2 && Number.isFinite(x) && Number.isFinite(y) ? [x!, y!] : undefined;
}

export class Following {
  /** Id of the followed subject; 0: none. */
  subject = 0;
  private readonly positions = new Map<number, Vec3>();
  private present: readonly number[] = [];
  private readonly together = new Set<number>(); // seen at the same time as the followed one
  private seenAt = -Infinity;
  private nearer = 0;
  private nearerSince = 0;

  constructor(private readonly mark: Mark = [0, 0]) {}

  /** Where a subject is; undefined keeps its latest position. */
  place(subject: number, at: Vec3 | undefined): void {
    if (at) this.positions.set(subject, at);
  }

  placeIfUnknown(subject: number, at: Vec3): void {
    if (!this.positions.has(subject)) this.positions.set(subject, at);
  }

  /** Takes the ids of the subjects now. Returns the followed one if it is among them, else 0. */
  update(subjects: readonly number[], now_ms: number): number {
    this.present = subjects;
    for (const id of this.positions.keys()) if (!subjects.includes(id)) this.positions.delete(id);
    const nearest = [...subjects].sort((a, b) => this.distance(a) - this.distance(b) || a - b)[0];
    if (nearest === undefined) return 0;
    if (subjects.includes(this.subject)) {
      this.seenAt = now_ms;
      for (const id of subjects) if (id !== this.subject) this.together.add(id);
      if (this.isNearer(nearest, now_ms)) this.follow(nearest, now_ms);
      return this.subject;
    }
    // One who was seen together with the followed one is another person, and the followed one may be hidden briefly.
    this.nearer = 0;
    if (this.subject !== 0 && this.together.has(nearest) && now_ms - this.seenAt < LOST_FOR_MS) return 0;
    this.follow(nearest, now_ms);
    return this.subject;
  }

  /**
   * Whether a subject is another one than the followed one. Volumes and poses arrive at different times: one who is only in
   * a volume may be the followed one, about to come or gone.
   */
  isOther(subject: number): boolean {
    return subject !== this.subject && this.present.includes(subject);
  }

  private distance(subject: number): number {
    const at = this.positions.get(subject);
    return at ? Math.hypot(at[0] - this.mark[0], at[1] - this.mark[1]) : Infinity;
  }

  private isNearer(nearest: number, now_ms: number): boolean {
    if (!(this.distance(nearest) < this.distance(this.subject) - NEARER_M)) {
      this.nearer = 0;
      return false;
    }
    if (this.nearer !== nearest) {
      this.nearer = nearest;
      this.nearerSince = now_ms;
    }
    return now_ms - this.nearerSince >= NEARER_FOR_MS;
  }

  private follow(subject: number, now_ms: number): void {
    this.subject = subject;
    this.seenAt = now_ms;
    this.nearer = 0;
    this.together.clear();
  }
}
