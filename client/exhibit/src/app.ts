// What the page knows and shows. Messages come in by message(), time by frame(); nothing else moves it.
import type { CaptureState, GetStatusResponse } from "./gen/kinevox/v1/capture_service_pb";
import type { StreamPosesResponse, StreamVolumesResponse } from "./gen/kinevox/v1/stream_service_pb";
import type { GatewayMessage } from "./gen/kinevox/web/v1/exhibit_pb";
import { AnglePanel } from "./angle_panel";
import { ChampionPanel } from "./champion_panel";
import type { Champion } from "./champions";
import type { Languages } from "./language";
import type { Scene } from "./scene";
import { ANGLES, JOINTS, type Angle, type Angles, type Joint, type Joints, type Vec3 } from "./skeleton";
import { Visit } from "./visit";
import { VolumeDecoder } from "./volume_codec";
import { DamagedVolume } from "./volume_sections";

const PANELS_EVERY_MS = 66; // numbers that change faster cannot be read
const ATTRACT_POSE_MS = 7_000; // a champion's turn while nobody is there
const RECENT_POSES = 24; // a volume is larger, and later, than its pose
const SILENT_MS = 2_500; // without a pose: what was shown is no longer so

const STATES: Record<CaptureState, string> = {
  0: "",
  1: "stopped",
  2: "starting",
  3: "",
  4: "learning",
  5: "ended",
  6: "failed",
};

const byId = (id: string) => document.getElementById(id)!;

export class App {
  readonly visit: Visit;
  readonly counts = {
    poses: 0,
    volumes: 0,
    volumesWithoutPose: 0,
    damaged: 0,
    refused: [] as string[],
    missed: 0,
    connections: 0,
  };
  private readonly decoder = new VolumeDecoder();
  private readonly anglePanel = new AnglePanel(byId("angle-rows"));
  private readonly championPanel: ChampionPanel;
  private gateway = false;
  private daemon: boolean | undefined; // undefined: not told yet
  private status: GetStatusResponse | undefined;
  private volume: StreamVolumesResponse | undefined; // not drawn yet
  private angles: Angles = {};
  private joints: Joints | undefined; // of the newest pose
  private readonly recent: { sequence: bigint; joints: Joints }[] = [];
  private drawn: Joints | undefined; // of the volume that is shown: the skeleton lies in the body
  private centre: Vec3 | undefined;
  private litres = 0;
  private heardAt = -Infinity;
  private panelsAt = -Infinity;
  private banner = "";
  private volumeNote = "";
  private shownChampion = -1;

  constructor(
    private readonly scene: Scene,
    private readonly languages: Languages,
    private readonly champions: readonly Champion[],
    private readonly clock: () => number,
  ) {
    this.visit = new Visit(champions[0]!);
    this.championPanel = new ChampionPanel(champions, (champion) => {
      this.visit.choose(champion);
      this.translate();
    });
  }

  translate(): void {
    document.documentElement.lang = this.languages.chosen;
    for (const element of document.querySelectorAll<HTMLElement>("[data-words]"))
      element.textContent = this.languages.say(element.dataset.words!);
    this.anglePanel.translate(this.languages);
    this.championPanel.translate(this.languages, this.visit);
    this.banner = this.volumeNote = "?"; // said anew
    this.shownChampion = -1;
    this.panelsAt = -Infinity;
  }

  connected(isConnected: boolean): void {
    this.gateway = isConnected;
    if (isConnected) this.counts.connections += 1;
    else this.daemon = undefined;
  }

  message({ message, missed }: GatewayMessage): void {
    this.counts.missed += Number(missed);
    switch (message.case) {
      case "pose":
        return this.pose(message.value);
      case "volume":
        this.volume = message.value; // the newest; drawn with the next picture
        return;
      case "status":
        this.status = message.value;
        return;
      case "link":
        this.daemon = message.value.connected;
        return;
      case "refusal":
        if (this.counts.refused.length < 16)
          this.counts.refused.push(`${message.value.code}: ${message.value.message}`);
    }
  }

  private pose({ header, pose }: StreamPosesResponse): void {
    this.counts.poses += 1;
    this.heardAt = this.clock();
    if (!pose) {
      this.nobody(); // or somebody who is not measured
      this.visit.saw(header?.subjectId ?? 0, {}, {}, this.heardAt);
      return;
    }
    const joints: Joints = {},
      angles: Angles = {};
    for (const joint of pose.joints) {
      const at = joint.positionInWorld;
      if (at && joint.withheld === "" && (JOINTS as readonly string[]).includes(joint.name))
        joints[joint.name as Joint] = [at.x, at.y, at.z];
    }
    for (const angle of pose.angles)
      if (
        angle.valueDeg !== undefined &&
        Number.isFinite(angle.valueDeg) &&
        (ANGLES as readonly string[]).includes(angle.name)
      )
        angles[angle.name as Angle] = angle.valueDeg;
    this.joints = joints;
    this.angles = angles;
    this.recent.push({ sequence: header?.sequence ?? 0n, joints });
    if (this.recent.length > RECENT_POSES) this.recent.shift();
    const root = joints.root;
    if (root) this.centre = root;
    this.visit.saw(header?.subjectId || pose.subjectId, joints, angles, this.heardAt);
  }

  private nobody(): void {
    this.joints = this.drawn = undefined;
    this.angles = {};
    this.recent.length = 0;
  }

  /** Shows what is known at `now_ms` of the clock. */
  frame(now_ms: number): void {
    if (now_ms - this.heardAt > SILENT_MS && this.joints) {
      this.nobody();
      this.scene.showVolume(undefined);
    }
    this.visit.passed(now_ms);
    this.showVolume();
    const attract = !this.visit.present;
    this.scene.showBody(this.joints && (this.drawn ?? this.joints));
    this.scene.showChampion(attract && !this.joints ? this.attractPose(now_ms) : undefined);
    if (now_ms - this.panelsAt >= PANELS_EVERY_MS) {
      this.panelsAt = now_ms;
      this.showPanels(attract);
    }
    this.scene.draw(now_ms, this.joints ? this.centre : undefined, attract);
  }

  private showVolume(): void {
    const message = this.volume;
    if (!message) return;
    this.volume = undefined;
    this.litres = message.litres;
    this.drawn = this.recent.find((pose) => pose.sequence === message.header?.sequence)?.joints;
    if (message.volume.length === 0) return this.scene.showVolume(undefined);
    try {
      this.scene.showVolume(this.decoder.decode(message.volume));
      this.counts.volumes += 1;
      if (!this.drawn) this.counts.volumesWithoutPose += 1;
    } catch (error) {
      if (!(error instanceof DamagedVolume)) throw error;
      this.counts.damaged += 1; // the next one comes in a moment
      this.scene.showVolume(undefined);
    }
  }

  private attractPose(now_ms: number): Joints {
    const number = Math.floor(now_ms / ATTRACT_POSE_MS) % this.champions.length;
    const champion = this.champions[number]!;
    if (number !== this.shownChampion) {
      this.shownChampion = number;
      byId("shown-name").textContent = this.languages.of(champion.name);
    }
    return champion.joints;
  }

  private showPanels(attract: boolean): void {
    document.body.classList.toggle("attract", attract);
    const note =
      this.joints && this.litres > 0 ? this.languages.say("volume", { litres: Math.round(this.litres) }) : "";
    if (note !== this.volumeNote) byId("volume-note").textContent = this.volumeNote = note;
    this.anglePanel.show(this.angles);
    this.championPanel.show(this.visit);
    const words = this.problem();
    if (words === this.banner) return;
    this.banner = words;
    byId("banner").hidden = words === "";
    byId("banner-words").textContent = words === "" ? "" : this.languages.say(words);
  }

  /** The words for what is wrong; "": nothing is. */
  private problem(): string {
    if (!this.gateway) return this.counts.connections > 0 ? "gateway_lost" : "loading";
    if (this.daemon === false) return "daemon_lost";
    return this.status ? (STATES[this.status.state] ?? "") : "";
  }

  get state() {
    return {
      ...this.counts,
      problem: this.problem(),
      present: this.visit.present,
      visit: this.visit.number,
      best: this.visit.best?.score.percent,
      now: this.visit.now?.percent,
      language: this.languages.chosen,
      joints: Object.keys(this.joints ?? {}).length,
    };
  }
}
