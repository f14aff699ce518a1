// JSON-RPC over the WebSocket to the rig (docs/service.md). Opens it again where it was lost.

const RETRY_MS = 500;

export class Rpc {
  // `listener`: { open(), lost(), notified(method, params) }
  constructor(listener) {
    this.listener = listener;
    this.next = 1;
    this.waiting = new Map();
    this.connect();
  }

  connect() {
    const url = new URL("ws" + location.search, location.href);
    url.protocol = "ws:";
    const socket = new WebSocket(url);
    this.socket = socket;
    socket.onopen = () => this.listener.open();
    socket.onmessage = (event) => this.take(JSON.parse(event.data));
    socket.onclose = () => {
      const lost = new Error("the connection to the rig was lost");
      for (const { reject } of this.waiting.values()) reject(lost);
      this.waiting.clear();
      this.listener.lost();
      setTimeout(() => this.connect(), RETRY_MS);
    };
  }

  get connected() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  take(message) {
    if (message.method !== undefined) {
      this.listener.notified(message.method, message.params);
      return;
    }
    const waits = this.waiting.get(message.id);
    this.waiting.delete(message.id);
    if (waits === undefined) return;
    if (message.error) waits.reject(new Error(message.error.message));
    else waits.resolve(message.result);
  }

  // Promise of the result.
  call(method, params) {
    if (!this.connected) return Promise.reject(new Error("not connected to the rig"));
    const id = this.next++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.socket.send(JSON.stringify({ jsonrpc: "2.0", id, method, params }));
    });
  }
}
