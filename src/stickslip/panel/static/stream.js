// The page's one connection: JSON both ways, float32 blocks from the server, back by itself after a loss.

const PAUSES = [250, 500, 1000, 2000];

/** Listeners by kind; `connection` is told { state, missed } of the connection itself. */
export function openStream(client) {
  const listeners = new Map();
  const seen = { boot: "", log: 0 };
  let socket = null;
  let failures = 0;
  let lostAt = 0;
  let beat = 0;

  const stream = {
    connected: false,
    /** Call `act` for messages of a kind; for blocks with (header, arrays). Returns what ends it. */
    on(kind, act) {
      if (!listeners.has(kind)) listeners.set(kind, new Set());
      listeners.get(kind).add(act);
      return () => listeners.get(kind).delete(act);
    },
    send(message) {
      if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    },
  };

  const tell = (kind, ...what) => {
    for (const act of [...(listeners.get(kind) || [])]) act(...what);
  };

  function receive(event) {
    beat = performance.now();
    if (typeof event.data === "string") {
      const message = JSON.parse(event.data);
      if (message.kind === "hello") {
        const again = lostAt ? (performance.now() - lostAt) / 1000 : 0;
        const restarted = seen.boot && seen.boot !== message.boot;
        if (restarted) seen.log = 0;
        seen.boot = message.boot;
        lostAt = 0;
        failures = 0;
        stream.connected = true;
        tell("connection", { state: "connected", missed: again, restarted });
      }
      if (message.kind === "log") for (const entry of message.entries) seen.log = Math.max(seen.log, entry.id);
      tell(message.kind, message);
      return;
    }
    const { header, arrays } = unpack(event.data);
    tell(header.kind, header, arrays);
  }

  function lost() {
    if (socket === null) return;
    socket = null;
    stream.connected = false;
    if (!lostAt) lostAt = performance.now();
    tell("connection", { state: "connection lost", missed: 0 });
    setTimeout(connect, PAUSES[Math.min(failures++, PAUSES.length - 1)]);
  }

  function connect() {
    const opened = (socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/stream`));
    opened.binaryType = "arraybuffer";
    opened.onopen = () => opened.send(JSON.stringify({ client, boot: seen.boot, log: seen.log }));
    opened.onmessage = (event) => opened === socket && receive(event);
    opened.onclose = () => opened === socket && lost();
    beat = performance.now();
  }

  // The server says something every second: silence means that the network is gone, though nobody said so.
  setInterval(() => {
    if (socket && performance.now() - beat > 6000) {
      const dead = socket;
      lost();
      dead.close();
    }
  }, 1000);
  // Listeners are there before the first message.
  queueMicrotask(connect);
  return stream;
}

/** Header and arrays of a binary message. */
export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let at = 4 + length;
  const arrays = header.lengths.map((count) => {
    const array = new Float32Array(buffer, at, count);
    at += 4 * count;
    return array;
  });
  return { header, arrays };
}
