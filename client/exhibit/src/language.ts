// The page's texts, one file per language: languages/LANGUAGE.json, listed in languages/index.json.
export type Texts = Record<string, string>;

export interface LanguageList {
  default: string;
  languages: Record<string, string>; // "de": "Deutsch"
}

/** Texts missing in a language come from the default language. */
export class Languages {
  chosen: string;
  private texts: Texts = {};
  constructor(
    readonly list: LanguageList,
    private readonly load: (name: string) => Promise<Texts>,
    wanted: string | null,
  ) {
    this.chosen = wanted !== null && wanted in list.languages ? wanted : list.default;
  }

  async choose(name: string): Promise<void> {
    if (!(name in this.list.languages)) return;
    this.chosen = name; // the last choice wins, whichever file is loaded first
    const fallback = await this.load(this.list.default);
    const own = name === this.list.default ? fallback : await this.load(name).catch(() => ({}));
    if (this.chosen === name) this.texts = { ...fallback, ...own };
  }

  /** The text of `key`, with {name} replaced by values.name. */
  text(key: string, values: Record<string, string | number> = {}): string {
    return (this.texts[key] ?? key).replace(/\{(\w+)\}/g, (_, name: string) => String(values[name] ?? ""));
  }

  of(texts: Record<string, string>): string {
    return texts[this.chosen] ?? texts[this.list.default] ?? texts.en ?? "";
  }
}
