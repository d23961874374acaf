// The live angles, as large numbers; a dash where nothing was measured.
import { sideOf, type Angle, type Angles } from "./skeleton";
import type { Languages } from "./language";

const ROWS: readonly { words: string; angles: readonly Angle[]; most_deg: number }[] = [
  { words: "knee_flexion", angles: ["knee_flexion_l", "knee_flexion_r"], most_deg: 150 },
  { words: "hip_flexion", angles: ["hip_flexion_l", "hip_flexion_r"], most_deg: 130 },
  { words: "elbow_flexion", angles: ["elbow_flexion_l", "elbow_flexion_r"], most_deg: 150 },
  { words: "shoulder_elevation", angles: ["shoulder_elevation_l", "shoulder_elevation_r"], most_deg: 180 },
  { words: "trunk_lean", angles: ["trunk_lean"], most_deg: 90 },
];

interface Cell {
  angle: Angle;
  most_deg: number;
  number: HTMLElement;
  bar: HTMLElement;
  shown: string;
}

export class AnglePanel {
  private readonly cells: Cell[] = [];
  private readonly names: [HTMLElement, string][] = [];

  constructor(parent: HTMLElement) {
    for (const row of ROWS) {
      const element = document.createElement("div");
      element.className = "angle";
      const name = document.createElement("span");
      name.className = "name";
      this.names.push([name, row.words]);
      const bar = document.createElement("div");
      bar.className = "bar";
      const numbers = row.angles.map((angle) => {
        const number = document.createElement("b");
        number.className = sideOf(angle);
        number.id = `angle-${angle}`;
        const piece = document.createElement("i");
        piece.className = sideOf(angle);
        if (row.angles.length === 1) piece.style.gridColumn = "1 / -1";
        bar.append(piece);
        this.cells.push({ angle, most_deg: row.most_deg, number, bar: piece, shown: "" });
        return number;
      });
      element.append(name, ...numbers, bar);
      parent.append(element);
    }
  }

  translate(languages: Languages): void {
    for (const [element, words] of this.names) element.textContent = languages.say(words);
  }

  show(angles: Angles): void {
    for (const cell of this.cells) {
      const value = angles[cell.angle];
      const text = value === undefined ? "–" : `${Math.round(value)}°`.replace("-", "−");
      if (text === cell.shown) continue;
      cell.shown = text;
      cell.number.textContent = text;
      cell.number.classList.toggle("absent", value === undefined);
      const part = value === undefined ? 0 : Math.min(1, Math.abs(value) / cell.most_deg);
      cell.bar.style.setProperty("--part", `${(100 * part).toFixed(1)}%`);
    }
  }
}
