// Scores, champion files, visits and languages.
import { readdirSync, readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { readChampion, score, type Champion } from "../src/champions";
import { Languages, type LanguageList, type Texts } from "../src/language";
import { mirrored, type Angles } from "../src/skeleton";
import { Visit } from "../src/visit";

const file = {
  name: { en: "A" },
  about: { en: "B" },
  angles_deg: { knee_flexion_geometric_l: 90, knee_flexion_geometric_r: 10, elbow_flexion_geometric_l: 0 },
  tolerance_deg: 20,
};
const champion = readChampion("a", file);
const alike = { ...file.angles_deg } as Angles;

describe("score", () => {
  it("decreases with the difference", () => {
    expect(score(alike, champion)!.percent).toBe(100);
    expect(score({ knee_flexion_geometric_l: 110, knee_flexion_geometric_r: 30, elbow_flexion_geometric_l: 20 }, champion)!.percent).toBe(50);
    expect(
      score({ knee_flexion_geometric_l: 0, knee_flexion_geometric_r: 100, elbow_flexion_geometric_l: 150 }, { ...champion, either_side: false })!
        .percent,
    ).toBeLessThan(5);
  });
  it("accepts the other side", () => {
    expect(score(mirrored(alike), champion)).toEqual({ percent: 100, mirrored: true });
    expect(score(mirrored(alike), { ...champion, either_side: false })!.percent).toBeLessThan(60);
  });
  it("ignores withheld angles, up to a third", () => {
    expect(score({ knee_flexion_geometric_l: 90 }, champion)).toBeUndefined();
    expect(score({}, champion)).toBeUndefined();
    expect(score({ knee_flexion_geometric_l: 90, knee_flexion_geometric_r: 10 }, champion)!.percent).toBe(100);
  });
  it("applies weights", () => {
    const heavy: Champion = { ...champion, either_side: false, weights: { elbow_flexion_geometric_l: 8 } };
    expect(score({ ...alike, elbow_flexion_geometric_l: 20 }, heavy)!.percent).toBe(60);
  });
});

describe("readChampion", () => {
  it("names the error in a file", () => {
    expect(() => readChampion("x", { ...file, angles_deg: { nose: 3, knee_flexion_geometric_l: 1, knee_flexion_geometric_r: 2 } })).toThrow(
      "unknown angle nose",
    );
    expect(() => readChampion("x", { ...file, angles_deg: {} })).toThrow("three angles");
    expect(() => readChampion("x", { ...file, name: {} })).toThrow("en");
    expect(() => readChampion("x", null)).toThrow("not an object");
    expect(() => readChampion("x", { ...file, tolerance_deg: -1 })).toThrow("tolerance_deg");
  });
});

describe("Visit", () => {
  const visit = () => new Visit(champion);
  const stay = (v: Visit, angles: Angles, from: number, to: number, subject = 1) => {
    for (let t = from; t <= to; t += 40) v.update(subject, {}, angles, t);
  };

  it("keeps the best score until the visitor leaves", () => {
    const v = visit();
    v.update(1, {}, alike, 0);
    expect(v.present).toBe(false);
    stay(v, { ...alike, knee_flexion_geometric_l: 60 }, 40, 1000);
    expect(v.present).toBe(true);
    const earlier = v.best!.score.percent;
    stay(v, alike, 1040, 1200);
    expect(v.best!.score.percent).toBe(100);
    stay(v, { knee_flexion_geometric_l: 0, knee_flexion_geometric_r: 0, elbow_flexion_geometric_l: 90 }, 1240, 1400);
    expect(v.best!.score.percent).toBe(100);
    expect(v.now!.percent).toBeLessThan(earlier);
    for (let t = 1440; t < 5300; t += 40) v.update(0, {}, {}, t);
    expect(v.present).toBe(true); // the visitor may have bent down
    expect(v.now).toBeUndefined();
    v.advance(5500);
    expect(v.present).toBe(false);
    expect(v.best).toBeUndefined();
    stay(v, {}, 6000, 7000);
    expect(v.present).toBe(true);
    expect(v.best).toBeUndefined();
  });

  it("starts again for a new subject", () => {
    const v = visit();
    stay(v, alike, 0, 1000, 1);
    v.update(2, {}, {}, 1040);
    expect(v.best).toBeUndefined();
  });

  it("keeps a best for each champion", () => {
    const v = visit(),
      other = readChampion("b", { ...file, angles_deg: { ...file.angles_deg, knee_flexion_geometric_l: 0 } });
    stay(v, alike, 0, 1000);
    v.choose(other);
    expect(v.best).toBeUndefined();
    v.choose(champion);
    expect(v.best!.score.percent).toBe(100);
  });
});

describe("languages", () => {
  const folder = new URL("../public/languages/", import.meta.url);
  const read = <T>(name: string) => JSON.parse(readFileSync(new URL(name, folder), "utf8")) as T;
  const list = read<LanguageList>("index.json");

  it("have all texts, also of champions", () => {
    const keys = Object.keys(read<Texts>(`${list.default}.json`)).sort();
    expect(readdirSync(folder).sort()).toEqual(
      [...Object.keys(list.languages).map((n) => `${n}.json`), "index.json"].sort(),
    );
    for (const name of Object.keys(list.languages))
      expect(Object.keys(read<Texts>(`${name}.json`)).sort(), name).toEqual(keys);
    const champions = new URL("../public/champions/", import.meta.url);
    for (const id of JSON.parse(readFileSync(new URL("index.json", champions), "utf8")) as string[]) {
      const one = readChampion(id, JSON.parse(readFileSync(new URL(`${id}.json`, champions), "utf8")));
      for (const name of Object.keys(list.languages))
        expect(one.name[name] && one.about[name], `${id} ${name}`).toBeTruthy();
    }
  });

  it("fall back to the default; the last choice wins", async () => {
    const files: Record<string, Texts> = { en: { a: "one {n}", b: "two" }, de: { a: "eins {n}" } };
    const waiting: (() => void)[] = [];
    const load = (name: string) => new Promise<Texts>((done) => waiting.push(() => done(files[name]!)));
    const languages = new Languages({ default: "en", languages: { en: "English", de: "Deutsch" } }, load, "xx");
    expect(languages.chosen).toBe("en");
    const flush = async () => {
      while (waiting.length > 0) {
        waiting.pop()!();
        await new Promise((done) => setTimeout(done));
      }
    };
    const both = [languages.choose("en"), languages.choose("de")];
    await flush();
    await Promise.all(both);
    expect(languages.text("a", { n: 1 })).toBe("eins 1");
    expect(languages.text("b")).toBe("two");
    await languages.choose("none");
    expect(languages.chosen).toBe("de");
  });
});
