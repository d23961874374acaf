// Which of several subjects is followed.
import { describe, expect, it } from "vitest";
import { Following, readMark, type Mark } from "../src/following";

/** People by id, with their distance along x. */
const see = (following: Following, people: Record<number, number>, from_ms: number, to_ms = from_ms) => {
  let followed = -1;
  for (let t = from_ms; t <= to_ms; t += 50) {
    for (const [id, x] of Object.entries(people)) following.place(Number(id), [x, 0, 1]);
    followed = following.update(Object.keys(people).map(Number), t);
  }
  return followed;
};

describe("Following", () => {
  it("follows the one nearest to the mark", () => {
    const nearest = (mark?: Mark) => see(new Following(mark), { 3: -1, 4: 0.2, 5: 2 }, 0);
    expect(nearest()).toBe(4);
    expect(nearest([3, 0])).toBe(5);
    expect(nearest([-3, 0])).toBe(3);
    expect(new Following().update([], 0)).toBe(0);
    expect(new Following().update([9, 7], 0), "positions are not known yet").toBe(7);
  });

  it("changes only to one who is clearly nearer for a while", () => {
    const f = new Following();
    see(f, { 1: 0.5, 2: 2 }, 0, 500);
    expect(see(f, { 1: 0.5, 2: 0.2 }, 550, 5000), "side by side").toBe(1);
    expect(see(f, { 1: 1.5, 2: 0.2 }, 5050, 5900), "passing").toBe(1);
    expect(see(f, { 1: 0.5, 2: 2 }, 5950, 6000)).toBe(1);
    expect(see(f, { 1: 1.5, 2: 0.2 }, 6050, 7000), "counts from the beginning").toBe(1);
    expect(see(f, { 1: 1.5, 2: 0.2 }, 7050, 7100)).toBe(2);
  });

  it("waits for one who is lost briefly", () => {
    const f = new Following();
    see(f, { 1: 0, 2: 1 }, 0, 500);
    expect(see(f, { 2: 1 }, 550, 1900)).toBe(0);
    expect(see(f, { 1: 0, 2: 1 }, 1950)).toBe(1);
    expect(see(f, { 2: 1 }, 2000, 3500), "gone").toBe(2);
  });

  it("follows a single one who gets another id at once", () => {
    const f = new Following();
    see(f, { 1: 0 }, 0, 500);
    expect(f.update([], 600)).toBe(0);
    expect(see(f, { 2: 1 }, 650)).toBe(2);
  });

  it("knows others only from the latest poses", () => {
    const f = new Following();
    expect(f.isOther(1), "a volume before the first pose").toBe(false);
    see(f, { 1: 0, 2: 1 }, 0, 500);
    expect([1, 2, 3].filter((id) => f.isOther(id))).toEqual([2]);
    see(f, { 2: 1 }, 550);
    expect(f.isOther(2), "while the followed one is hidden").toBe(true);
    see(f, { 4: 0 }, 3000);
    expect([1, 2, 4].filter((id) => f.isOther(id)), "volumes of those who are gone").toEqual([]);
  });
});

describe("readMark", () => {
  it("reads metres and nothing else", () => {
    expect(readMark("1.5,-2")).toEqual([1.5, -2]);
    for (const wrong of ["", "1", "1,", "1,2,3", "a,b", "1,Infinity"]) expect(readMark(wrong), wrong).toBeUndefined();
  });
});
