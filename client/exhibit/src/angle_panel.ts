// The live angles as large numbers; a dash for withheld angles.
import { sideOf, type Angle, type Angles } from "./skeleton";
import type { Languages } from "./language";

const ROWS: readonly { label: string; angles: readonly Angle[]; max_deg: number }[] = [
  { label: "knee_flexion", angles: ["knee_flexion_geometric_l", "knee_flexion_geometric_r"], max_deg: 150 },
  { label: "hip_flexion", angles: ["hip_flexion_geometric_l", "hip_flexion_geometric_r"], max_deg: 130 },
  { label: "elbow_flexion", angles: ["elbow_flexion_geometric_l", "elbow_flexion_geometric_r"], max_deg: 150 },
  { label: "shoulder_elevation", angles: ["shoulder_elevation_geometric_l", "shoulder_elevation_geometric_r"], max_deg: 180 },
  { label: "trunk_lean", angles: ["trunk_lean_geometric"], max_deg: 90 },
];

interface Cell {
  angle: Angle;
  max_deg: number;
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
      this.names.push([name, row.label]);
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
        this.cells.push({ angle, max_deg: row.max_deg, number, bar: piece, shown: "" });
        return number;
      });
      element.append(name, ...numbers, bar);
      parent.append(element);
    }
  }

  translate(languages: Languages): void {
    for (const [element, label] of this.names) element.textContent = languages.text(label);
  }

  show(angles: Angles): void {
    for (const cell of this.cells) {
      const value = angles[cell.angle];
      const text = value === undefined ? "–" : `${Math.round(value)}°`.replace("-", "−");
      if (text === cell.shown) continue;
      cell.shown = text;
      cell.number.textContent = text;
      cell.number.classList.toggle("absent", value === undefined);
      const fraction = value === undefined ? 0 : Math.min(1, Math.abs(value) / cell.max_deg);
      cell.bar.style.setProperty("--fraction", `${(100 * fraction).toFixed(1)}%`);
    }
  }
}
