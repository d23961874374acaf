// The WebSocket to the gateway: subscribes, reports the connection, reconnects.
import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import { BrowserMessageSchema, GatewayMessageSchema, StreamKind, type GatewayMessage } from "./gen/kinevox/web/v1/exhibit_pb";

export interface Subscription {
  kind: StreamKind;
  downsampleLevel?: number;
  camera?: string;
  maxRateHz?: number;
}

const FIRST_PAUSE_MS = 400,
  MAX_PAUSE_MS = 5_000;
const IDLE_TIMEOUT_MS = 6_000; // the gateway sends a heartbeat every two seconds
const CHECK_INTERVAL_MS = 1_000;
const RETRY_MS = 10_000; // after a StreamError: a camera may exist by then

export interface LinkListener {
  message(message: GatewayMessage): void;
  connected(isConnected: boolean): void;
}

export class Link {
  private socket: WebSocket | undefined;
  private pause = FIRST_PAUSE_MS;
  private receivedAt = 0;
  private opened = false;
  private subscriptions: readonly Subscription[] = [];
  private errorAt: number | undefined;

  constructor(
    private readonly url: string,
    private readonly listener: LinkListener,
  ) {
    setInterval(() => this.check(performance.now()), CHECK_INTERVAL_MS);
    this.connect();
  }

  subscribe(subscriptions: readonly Subscription[]): void {
    this.subscriptions = subscriptions;
    if (this.socket?.readyState === WebSocket.OPEN)
      this.socket.send(
        toBinary(
          BrowserMessageSchema,
          create(BrowserMessageSchema, {
            subscriptions: subscriptions.map((subscription) => ({
              kind: subscription.kind,
              downsampleLevel: subscription.downsampleLevel ?? 0,
              camera: subscription.camera ?? "",
              maxRateHz: subscription.maxRateHz ?? 0,
            })),
          }),
        ),
      );
  }

  private connect(): void {
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.receivedAt = performance.now();
    socket.onopen = () => {
      this.opened = true;
      this.listener.connected(true);
      this.subscribe(this.subscriptions);
    };
    socket.onmessage = (event: MessageEvent<ArrayBuffer>) => {
      this.receivedAt = performance.now();
      this.pause = FIRST_PAUSE_MS;
      this.receive(new Uint8Array(event.data));
    };
    socket.onclose = () => this.lost(socket);
  }

  /** Handles one message as received. */
  receive(bytes: Uint8Array): void {
    let message: GatewayMessage;
    try {
      message = fromBinary(GatewayMessageSchema, bytes);
    } catch {
      return; // of another version
    }
    if (message.payload.case === "error") this.errorAt = performance.now();
    this.listener.message(message);
  }

  private lost(socket: WebSocket): void {
    if (socket !== this.socket) return;
    socket.onopen = socket.onmessage = socket.onclose = null;
    this.socket = undefined;
    if (this.opened) this.listener.connected(false);
    this.opened = false;
    setTimeout(() => this.connect(), this.pause);
    this.pause = Math.min(2 * this.pause, MAX_PAUSE_MS);
  }

  private check(now: number): void {
    if (this.socket && now - this.receivedAt > IDLE_TIMEOUT_MS) {
      const socket = this.socket;
      socket.close();
      this.lost(socket); // without an answer the browser needs a minute to close
    } else if (this.errorAt !== undefined && now - this.errorAt > RETRY_MS) {
      this.errorAt = undefined;
      this.subscribe(this.subscriptions);
    }
  }
}
