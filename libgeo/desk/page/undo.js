// What a person did, so that it can be undone and done again: { text, undo, redo }, both of which call the desk.

const makeHistory = ({ onChange, onProblem }) => {
  const done = [], undone = [];
  let busy = false;
  const move = async (from, to, name) => {
    if (busy || from.length === 0) return;
    busy = true;
    const action = from.pop();
    try {
      await action[name]();
      to.push(action);
      onProblem(name === "undo" ? `undone: ${action.text}` : `done again: ${action.text}`);
    } catch (problem) {
      onProblem(problem.message);
    }
    busy = false;
    onChange(done.length > 0, undone.length > 0);
  };
  return {
    add: (action) => { done.push(action); undone.length = 0; onChange(true, false); },
    undo: () => move(done, undone, "undo"),
    redo: () => move(undone, done, "redo"),
    clear: () => { done.length = undone.length = 0; onChange(false, false); },
  };
};
