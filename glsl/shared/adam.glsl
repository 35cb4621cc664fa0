// One step of Adam for a vec4 of parameters, for kernels with `counts`, `params`, both moments and a `push` with the
// constants of Adam.

// Updates the moments along the gradient `g`; `next` are the parameters after the step. A gradient that is not finite,
// or with a square that is not, leaves all as they are and is counted: false. The kernels of all degrees take the same
// step to the bit: `precise` keeps compilers from fusing products into sums in some of them.
bool take_step(uint place, uint splat, vec4 g, vec4 rate, out vec4 next) {
    // An infinite square would stay in the second moment.
    if (!is_finite(g * g)) {
        atomicAdd(counts[COUNT_POISONED], 1);
        atomicMax(counts[COUNT_POISONED_FIRST], 0xffffffffu - (push.first_splat + splat));
        return false;
    }
    precise vec4 m = push.beta1 * moment1[place] + (1.0 - push.beta1) * g;
    precise vec4 v = push.beta2 * moment2[place] + (1.0 - push.beta2) * g * g;
    moment1[place] = m;
    moment2[place] = v;
    precise vec4 step = rate * (m * push.correction1) / (sqrt(v * push.correction2) + push.epsilon);
    precise vec4 after = params[place] - step;
    next = after;
    return true;
}
