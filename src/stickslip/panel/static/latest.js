// One request at a time, and always for the newest wish: no backlog, however fast wishes come.

/**
 * `ask(wish)` fetches, `take(answer, wish)` shows, `refuse(error, wish)` says what is wrong. At least `pause` ms lie
 * between two requests.
 */
export function latestWins({ ask, take, refuse, pause = 0 }) {
  let wish = null, busy = false, ended = false, last = -Infinity;
  async function work() {
    busy = true;
    while (wish !== null && !ended) {
      const rest = pause - (performance.now() - last);
      if (rest > 0) await new Promise((done) => setTimeout(done, rest));
      const mine = wish;
      wish = null;
      last = performance.now();
      if (mine === null || ended) break;
      try {
        const answer = await ask(mine);
        if (!ended) take(answer, mine);
      } catch (error) {
        if (!ended && error.name !== "AbortError") refuse(error, mine);
      }
    }
    busy = false;
  }
  return {
    want(next) {
      wish = next;
      if (!busy) work();
    },
    get busy() { return busy; },
    end() { ended = true; },
  };
}
