// Champions' poses, read from files, and the similarity of a visitor's pose.
import { figure, type Drawn } from "./figure";
import { ANGLES, mirrored, type Angle, type Angles, type Joints } from "./skeleton";

export interface ChampionFile {
  name: Record<string, string>; // by language
  about: Record<string, string>;
  angles_deg: Angles; // compared
  drawn_deg?: Drawn;
  weights?: Partial<Record<Angle, number>>; // 1 where not given
  tolerance_deg?: number; // difference that halves the score; 20 where not given
  either_side?: boolean; // left and right may be exchanged; true where not given
}

export interface Champion extends ChampionFile {
  id: string;
  joints: Joints;
}

export interface Score {
  percent: number;
  mirrored: boolean; // with left and right exchanged
}

const MIN_MEASURED_FRACTION = 2 / 3;

/** Throws an error of one line that names file and key. */
export function readChampion(id: string, file: unknown): Champion {
  const problem = (what: string) => new Error(`champions/${id}.json: ${what}`);
  const champion = file as ChampionFile;
  if (typeof champion !== "object" || champion === null) throw problem("is not an object");
  for (const key of ["name", "about"] as const)
    if (typeof champion[key]?.en !== "string") throw problem(`${key} has no text for "en"`);
  const names = Object.keys(champion.angles_deg ?? {});
  if (names.length < 3) throw problem("angles_deg needs at least three angles");
  for (const name of names) {
    if (!(ANGLES as readonly string[]).includes(name))
      throw problem(`unknown angle ${name}; the angles are ${ANGLES.join(", ")}`);
    if (!Number.isFinite(champion.angles_deg[name as Angle])) throw problem(`${name} is not a number`);
  }
  if (champion.tolerance_deg !== undefined && !(champion.tolerance_deg > 0))
    throw problem("tolerance_deg must be above 0");
  return { ...champion, id, joints: figure(champion.angles_deg, champion.drawn_deg) };
}

function similarity(measured: Angles, champion: ChampionFile): number | undefined {
  const tolerance = champion.tolerance_deg ?? 20;
  let sum = 0,
    weights = 0,
    all = 0;
  for (const [name, wanted] of Object.entries(champion.angles_deg) as [Angle, number][]) {
    const weight = champion.weights?.[name] ?? 1,
      value = measured[name];
    all += weight;
    if (value === undefined) continue;
    weights += weight;
    sum += weight * 0.5 ** (((value - wanted) / tolerance) ** 2);
  }
  return all > 0 && weights >= MIN_MEASURED_FRACTION * all ? sum / weights : undefined;
}

/** Undefined where too many of the angles are withheld. */
export function score(measured: Angles, champion: ChampionFile): Score | undefined {
  const straight = similarity(measured, champion);
  const other = champion.either_side === false ? undefined : similarity(mirrored(measured), champion);
  if (straight === undefined && other === undefined) return undefined;
  const exchanged = (other ?? -1) > (straight ?? -1);
  return { percent: Math.round(100 * (exchanged ? other! : straight!)), mirrored: exchanged };
}
