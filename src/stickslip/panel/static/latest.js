// One request at a time, and always for the newest wish: no backlog, however fast wishes come.

const LONGEST_REST = 600; // ms

/**
 * `ask(wish)` fetches, `take(answer, wish)` shows, `refuse(error, wish)` says what is wrong. Requests take no more
 * than this `share` of the time, so that what is more urgent has the rest.
 */
export function latestWins({ ask, take, refuse, share = 1 }) {
  let wish = null, busy = false, ended = false, next = -Infinity;
  async function work() {
    busy = true;
    while (wish !== null && !ended) {
      const rest = next - performance.now();
      if (rest > 0) await new Promise((done) => setTimeout(done, rest));
      const mine = wish;
      wish = null;
      const began = performance.now();
      if (mine === null || ended) break;
      try {
        const answer = await ask(mine);
        if (!ended) take(answer, mine);
      } catch (error) {
        if (!ended) refuse(error, mine);
      }
      const now = performance.now();
      next = now + Math.min((now - began) * (1 / share - 1), LONGEST_REST);
    }
    busy = false;
  }
  return {
    want(newest) {
      wish = newest;
      if (!busy) work();
    },
    get busy() { return busy; },
    end() { ended = true; },
  };
}
