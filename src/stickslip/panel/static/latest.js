// Few requests at a time, and always for the newest wish: no backlog, however fast wishes come.

const LONGEST_REST = 600; // ms

/**
 * `ask(wish)` fetches, `take(answer, wish)` shows, `refuse(error, wish)` says what is wrong; answers that a newer one
 * has overtaken are dropped. As many as `abreast` are under way at once: one is computed while another is drawn.
 * Requests take no more than this `share` of the time, so that what is more urgent has the rest.
 */
export function latestWins({ ask, take, refuse, share = 1, abreast = 1 }) {
  let wish = null, working = 0, ended = false, next = -Infinity, asked = 0, shown = 0;
  async function work() {
    working++;
    while (wish !== null && !ended) {
      const rest = next - performance.now();
      if (rest > 0) await new Promise((done) => setTimeout(done, rest));
      const mine = wish;
      wish = null;
      const began = performance.now();
      if (mine === null || ended) break;
      const number = ++asked;
      const newest = (act) => (found) => {
        if (ended || number < shown) return;
        shown = number;
        act(found, mine);
      };
      await ask(mine).then(newest(take), newest(refuse));
      const now = performance.now();
      next = now + Math.min((now - began) * (1 / share - 1), LONGEST_REST);
    }
    working--;
  }
  return {
    want(newest) {
      wish = newest;
      if (working < abreast) work();
    },
    get busy() { return working > 0; },
    end() { ended = true; },
  };
}
