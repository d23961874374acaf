// The state of the page and its display, driven only by message() and frame().
import type { CaptureState, GetStatusResponse } from "./gen/kinevox/v1/capture_service_pb";
import type { StreamPosesResponse, StreamVolumesResponse, SubjectVolume } from "./gen/kinevox/v1/stream_service_pb";
import type { GatewayMessage } from "./gen/kinevox/web/v1/exhibit_pb";
import { AnglePanel } from "./angle_panel";
import { ChampionPanel } from "./champion_panel";
import type { Champion } from "./champions";
import { Following, type Mark } from "./following";
import type { Languages } from "./language";
import type { Scene } from "./scene";
import { ANGLES, JOINTS, type Angle, type Angles, type Joint, type Joints, type Vec3 } from "./skeleton";
import { Visit } from "./visit";
import { VolumeDecoder, type Surface } from "./volume_codec";
import { DamagedVolume } from "./volume_sections";

const PANEL_INTERVAL_MS = 66; // numbers that change faster cannot be read
const ATTRACT_POSE_MS = 7_000; // time per champion in attract mode
const RECENT_POSES = 24; // a volume arrives later than its pose
const IDLE_TIMEOUT_MS = 2_500; // without a pose: hide the visitor

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
    others: 0, // outlines of the latest volumes
    damaged: 0,
    errors: [] as string[],
    missed: 0,
    connections: 0,
  };
  private readonly following: Following;
  private readonly decoder = new VolumeDecoder();
  private readonly anglePanel = new AnglePanel(byId("angle-rows"));
  private readonly championPanel: ChampionPanel;
  private gateway = false;
  private daemon: boolean | undefined; // undefined: not known yet
  private status: GetStatusResponse | undefined;
  private volume: StreamVolumesResponse | undefined; // received, not drawn yet
  private angles: Angles = {};
  private joints: Joints | undefined; // of the latest pose
  private readonly recent: { sequence: bigint; joints: Joints }[] = [];
  private drawn: Joints | undefined; // of the volume shown, so that the skeleton matches it
  private centre: Vec3 | undefined;
  private volumeLitres = 0;
  private receivedAt = -Infinity;
  private panelsAt = -Infinity;
  private banner = "";
  private volumeNote = "";
  private name = ""; // of the followed visitor, given by an operator
  private shownName = "";
  private shownChampion = -1;

  constructor(
    private readonly scene: Scene,
    private readonly languages: Languages,
    private readonly champions: readonly Champion[],
    private readonly clock: () => number,
    mark?: Mark,
  ) {
    this.following = new Following(mark);
    this.visit = new Visit(champions[0]!);
    this.championPanel = new ChampionPanel(champions, (champion) => {
      this.visit.choose(champion);
      this.translate();
    });
  }

  translate(): void {
    document.documentElement.lang = this.languages.chosen;
    for (const element of document.querySelectorAll<HTMLElement>("[data-text]"))
      element.textContent = this.languages.text(element.dataset.text!);
    this.anglePanel.translate(this.languages);
    this.championPanel.translate(this.languages, this.visit);
    this.banner = this.volumeNote = "?"; // force an update
    this.shownChampion = -1;
    this.panelsAt = -Infinity;
  }

  connected(isConnected: boolean): void {
    this.gateway = isConnected;
    if (isConnected) this.counts.connections += 1;
    else this.daemon = undefined;
  }

  message({ payload, missedCount }: GatewayMessage): void {
    this.counts.missed += Number(missedCount);
    switch (payload.case) {
      case "pose":
        return this.pose(payload.value);
      case "volume":
        this.volume = payload.value; // drawn with the next frame
        return;
      case "status":
        this.status = payload.value;
        return;
      case "connection":
        this.daemon = payload.value.connected;
        return;
      case "error":
        if (this.counts.errors.length < 16)
          this.counts.errors.push(`${payload.value.code}: ${payload.value.message}`);
    }
  }

  private pose({ header, subjects }: StreamPosesResponse): void {
    this.counts.poses += 1;
    this.receivedAt = this.clock();
    for (const { subjectId, pose } of subjects) {
      const root = pose?.joints.find((joint) => joint.name === "root")?.positionInWorld;
      this.following.place(subjectId, root && [root.x, root.y, root.z]);
    }
    const before = this.following.subject;
    const followed = this.following.update(
      subjects.map((subject) => subject.subjectId),
      this.receivedAt,
    );
    if (this.following.subject !== before) this.clearBody(); // the recent poses are of another one
    const subject = subjects.find(({ subjectId }) => subjectId === followed);
    this.name = subject?.name ?? "";
    const pose = subject?.pose;
    if (!pose) {
      this.clearBody(); // not there, or no pose found
      this.visit.update(followed, {}, {}, this.receivedAt);
      return;
    }
    const joints: Joints = {},
      angles: Angles = {};
    for (const joint of pose.joints) {
      const at = joint.positionInWorld;
      if (at && joint.withheldReason === "" && (JOINTS as readonly string[]).includes(joint.name))
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
    this.visit.update(followed, joints, angles, this.receivedAt);
  }

  private clearBody(): void {
    this.joints = this.drawn = undefined;
    this.angles = {};
    this.recent.length = 0;
  }

  /** Updates scene and panels for the time `now_ms`. */
  frame(now_ms: number): void {
    if (now_ms - this.receivedAt > IDLE_TIMEOUT_MS && this.joints) {
      this.clearBody();
      this.scene.showVolume(undefined);
      this.showOthers([]);
    }
    this.visit.advance(now_ms);
    this.showVolume();
    const attract = !this.visit.present;
    this.scene.showBody(this.joints && (this.drawn ?? this.joints));
    this.scene.showChampion(attract && !this.joints ? this.attractPose(now_ms) : undefined);
    if (now_ms - this.panelsAt >= PANEL_INTERVAL_MS) {
      this.panelsAt = now_ms;
      this.showPanels(attract);
    }
    this.scene.draw(now_ms, this.joints ? this.centre : undefined, attract);
  }

  private showVolume(): void {
    const message = this.volume;
    if (!message) return;
    this.volume = undefined;
    for (const { subject } of message.subjects) {
      const centre = subject?.centreInWorld;
      // A subject without a pose has the position of its volume.
      if (subject && centre) this.following.placeIfUnknown(subject.subjectId, [centre.x, centre.y, centre.z]);
    }
    const isFollowed = ({ subject }: SubjectVolume) => subject?.subjectId === this.following.subject;
    const followed = message.subjects.find(isFollowed);
    this.volumeLitres = followed?.volumeLitres ?? 0;
    this.drawn = this.recent.find((pose) => pose.sequence === message.header?.sequence)?.joints;
    const shown = this.decodeAndShow(followed, (surface) => this.scene.showVolume(surface));
    if (shown) {
      this.counts.volumes += 1;
      if (!this.drawn) this.counts.volumesWithoutPose += 1;
    }
    this.showOthers(message.subjects.filter(({ subject }) => subject && this.following.isOther(subject.subjectId)));
  }

  /** The others are outlines. */
  private showOthers(others: readonly SubjectVolume[]): void {
    let count = 0;
    for (const other of others)
      if (this.decodeAndShow(other, (surface) => surface && this.scene.showOther(count, surface))) count += 1;
    this.scene.hideOthersFrom(count);
    this.counts.others = count;
  }

  /** Shows nothing and returns false if there is no volume, or a damaged one: the next volume follows at once. */
  private decodeAndShow(volume: SubjectVolume | undefined, show: (surface: Surface | undefined) => void): boolean {
    let surface: Surface | undefined;
    try {
      if (volume && volume.encodedVolume.length > 0) surface = this.decoder.decode(volume.encodedVolume);
    } catch (error) {
      if (!(error instanceof DamagedVolume)) throw error;
      this.counts.damaged += 1;
    }
    show(surface);
    return surface !== undefined;
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
      this.joints && this.volumeLitres > 0 ? this.languages.text("volume", { litres: Math.round(this.volumeLitres) }) : "";
    if (note !== this.volumeNote) byId("volume-note").textContent = this.volumeNote = note;
    const name = byId("visitor-name");
    if (this.name !== this.shownName) name.textContent = this.shownName = this.name;
    name.hidden = this.name === "";
    this.anglePanel.show(this.angles);
    this.championPanel.show(this.visit);
    const problem = this.problem();
    if (problem === this.banner) return;
    this.banner = problem;
    byId("banner").hidden = problem === "";
    byId("banner-text").textContent = problem === "" ? "" : this.languages.text(problem);
  }

  /** The key of the text that describes the current problem; empty: none. */
  private problem(): string {
    if (!this.gateway) return this.counts.connections > 0 ? "gateway_lost" : "loading";
    if (this.daemon === false) return "daemon_lost";
    return this.status ? (STATES[this.status.state] ?? "") : "";
  }

  get state() {
    return {
      ...this.counts,
      at: this.centre, // of the followed visitor
      name: this.name,
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
