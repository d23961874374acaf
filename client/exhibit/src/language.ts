// The page's words, a file a language: languages/LANGUAGE.json, listed in languages/index.json.
export type Words = Record<string, string>;

export interface LanguageList {
  default: string;
  languages: Record<string, string>; // "de": "Deutsch"
}

/** What a language's file lacks is said in the default language. */
export class Languages {
  chosen: string;
  private words: Words = {};
  constructor(
    readonly list: LanguageList,
    private readonly load: (name: string) => Promise<Words>,
    wanted: string | null,
  ) {
    this.chosen = wanted !== null && wanted in list.languages ? wanted : list.default;
  }

  async choose(name: string): Promise<void> {
    if (!(name in this.list.languages)) return;
    this.chosen = name; // the last touch wins, whichever file comes first
    const fallback = await this.load(this.list.default);
    const own = name === this.list.default ? fallback : await this.load(name).catch(() => ({}));
    if (this.chosen === name) this.words = { ...fallback, ...own };
  }

  /** {name} in a text is replaced. */
  say(key: string, values: Record<string, string | number> = {}): string {
    return (this.words[key] ?? key).replace(/\{(\w+)\}/g, (_, name: string) => String(values[name] ?? ""));
  }

  of(texts: Record<string, string>): string {
    return texts[this.chosen] ?? texts[this.list.default] ?? texts.en ?? "";
  }
}
