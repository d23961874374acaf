// The WebSocket to the gateway: connects, asks, says when it is gone, keeps trying.
import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import { BrowserMessageSchema, GatewayMessageSchema, Kind, type GatewayMessage } from "./gen/kinevox/web/v1/exhibit_pb";

export interface Want {
  kind: Kind;
  level?: number;
  camera?: string;
  maxRateHz?: number;
}

const FIRST_PAUSE_MS = 400,
  LONGEST_PAUSE_MS = 5_000;
const SILENT_MS = 6_000; // the gateway gives a sign of life every two seconds
const LOOK_MS = 1_000;
const ASK_AGAIN_MS = 10_000; // what was refused: the daemon may have learned better

export interface LinkListener {
  message(message: GatewayMessage): void;
  connected(isConnected: boolean): void;
}

export class Link {
  private socket: WebSocket | undefined;
  private pause = FIRST_PAUSE_MS;
  private heardAt = 0;
  private opened = false;
  private wants: readonly Want[] = [];
  private refusedAt: number | undefined;

  constructor(
    private readonly url: string,
    private readonly listener: LinkListener,
  ) {
    setInterval(() => this.look(performance.now()), LOOK_MS);
    this.connect();
  }

  ask(wants: readonly Want[]): void {
    this.wants = wants;
    if (this.socket?.readyState === WebSocket.OPEN)
      this.socket.send(
        toBinary(
          BrowserMessageSchema,
          create(BrowserMessageSchema, {
            wants: wants.map((want) => ({
              kind: want.kind,
              level: want.level ?? 0,
              camera: want.camera ?? "",
              maxRateHz: want.maxRateHz ?? 0,
            })),
          }),
        ),
      );
  }

  private connect(): void {
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heardAt = performance.now();
    socket.onopen = () => {
      this.opened = true;
      this.listener.connected(true);
      this.ask(this.wants);
    };
    socket.onmessage = (event: MessageEvent<ArrayBuffer>) => {
      this.heardAt = performance.now();
      this.pause = FIRST_PAUSE_MS;
      this.receive(new Uint8Array(event.data));
    };
    socket.onclose = () => this.lost(socket);
  }

  /** One message as it came. */
  receive(bytes: Uint8Array): void {
    let message: GatewayMessage;
    try {
      message = fromBinary(GatewayMessageSchema, bytes);
    } catch {
      return; // of another version; what it says is said again
    }
    if (message.message.case === "refusal") this.refusedAt = performance.now();
    this.listener.message(message);
  }

  private lost(socket: WebSocket): void {
    if (socket !== this.socket) return;
    socket.onopen = socket.onmessage = socket.onclose = null;
    this.socket = undefined;
    if (this.opened) this.listener.connected(false);
    this.opened = false;
    setTimeout(() => this.connect(), this.pause);
    this.pause = Math.min(2 * this.pause, LONGEST_PAUSE_MS);
  }

  private look(now: number): void {
    if (this.socket && now - this.heardAt > SILENT_MS) {
      const socket = this.socket;
      socket.close();
      this.lost(socket); // a closing that nobody answers takes the browser a minute
    } else if (this.refusedAt !== undefined && now - this.refusedAt > ASK_AGAIN_MS) {
      this.refusedAt = undefined;
      this.ask(this.wants);
    }
  }
}
