"""What every MATLAB file has beside its formulas: its help, and rollouts that locate events.

The text before ``%%`` opens the function of the file, that after it follows the formulas.
"""

RUNTIME = r"""%
%   model = NAME() is a struct of functions. x and u are columns, modes count from zero.
%   model.rhs(t, x, u, mode)               rate of each state
%   model.guard(edge, t, x, u, entered)    an edge leaves its mode where this rises to zero
%   model.reset(edge, t, x, u, entered)    the state after it; entered is when the mode began
%   model.start(t, x, u, label)            the mode to start in, of those of a label; -1 is any
%   model.events(t, x, u, mode, entered)   value, isterminal, direction, as odeset takes them:
%       odeset('Events', @(t, x) model.events(t, x, u, mode, entered))
%   [x, mode, events] = model.simulate(t, x0, label, u, hold)   rows at the instants t; u has a
%       row for each, hold is 'zero' or 'linear'; events are rows of time, edge and mode
    model.rhs = @rhs; model.guard = @guard; model.reset = @reset; model.start = @start;
    model.events = @events; model.simulate = @simulate;
%%
function y = pick(condition, one, other)
    if condition > 0, y = one; else, y = other; end
end

function [value, isterminal, direction] = events(t, x, u, mode, entered)
    model = NAME();
    value = -ones(numel(model.source), 1);
    for edge = find(model.source == mode)
        value(edge) = guard(edge, t, x, u, entered);
    end
    isterminal = ones(size(value)); direction = isterminal;
end

function [x, mode, happened] = simulate(t, x0, label, u, hold)
    model = NAME();
    if nargin < 3 || isempty(label), label = -1; end
    if nargin < 4 || isempty(u), u = zeros(numel(t), max(numel(model.inputs), 1)); end
    if nargin < 5, hold = 'zero'; end
    x = nan(numel(t), numel(x0)); mode = nan(numel(t), 1); happened = zeros(0, 3);
    s.t = t(1); s.x = x0(:); s.entered = t(1); s.shift = zeros(1, numel(model.source));
    s.mode = start(t(1), s.x, u(1, :)', label);
    if s.mode < 0, error('NAME: the state tells another mode than %d.', label); end
    step = (t(end) - t(1)) / 100;
    s = enter(model, s, u(1, :)');
    for k = 1:numel(t)
        last = max(k - 1, 1); from = u(last, :)'; to = from;
        if strcmp(hold, 'linear'), to = u(k, :)'; end
        slope = (to - from) / max(t(k) - t(last), realmin);
        input = @(time) from + slope * (time - t(last));
        [s, happened] = settle(model, s, input(s.t), happened);
        while s.t < t(k)
            h = min(step, t(k) - s.t);
            [y, off] = advanced(model, s, input, h);
            if off > 1, step = h * max(0.2, 0.9 * off^(-0.2)); continue, end
            if any(indicators(model, s, s.t + h, y, input) >= 0)
                low = 0; high = h; middle = h / 2;
                while low < middle && middle < high && s.t + low < s.t + high
                    y = advanced(model, s, input, middle);
                    if any(indicators(model, s, s.t + middle, y, input) >= 0)
                        high = middle;
                    else
                        low = middle;
                    end
                    middle = (low + high) / 2;
                end
                y = advanced(model, s, input, high);
                due = find(indicators(model, s, s.t + high, y, input) >= 0, 1);
                s.t = s.t + high; s.x = y;
                if ~isempty(due), [s, happened] = taken(model, s, input(s.t), happened, due); end
                [s, happened] = settle(model, s, input(s.t), happened);
                continue
            end
            if h < step, s.t = t(k); else, s.t = s.t + h; end
            s.x = y; step = max(step, h * min(5, 0.9 * max(off, 1e-9)^(-0.2)));
            for edge = find(model.source == s.mode)  % a guard that has been below zero counts
                below = guard(edge, s.t, s.x, input(s.t), s.entered) < -s.shift(edge);
                if below, s.shift(edge) = 0; end
            end
        end
        x(k, :) = s.x'; mode(k) = model.label(s.mode + 1);
    end
end

function value = indicators(model, s, t, x, input)
    % guards of the mode; one that has just fired is shifted until it has been below zero
    value = -ones(1, numel(model.source));
    for edge = find(model.source == s.mode)
        held = guard(edge, t, x, input(t), s.entered);
        if s.shift(edge) > 0, held = -1; end
        value(edge) = held;
    end
end

function s = enter(model, s, u)
    % which guards have to fall below zero before they count, by what they are a moment later
    f = rhs(s.t, s.x, u, s.mode); s.shift(:) = 0;
    for edge = find(model.source == s.mode)
        value = guard(edge, s.t, s.x, u, s.entered); band = 1e-12 * (1 + abs(s.t));
        for n = 1:numel(s.x)
            moved = s.x; d = 1e-6 * (abs(s.x(n)) + model.size(n)); change = inf;
            for side = [-d, d]
                moved(n) = s.x(n) + side;
                change = min(change, abs(guard(edge, s.t, moved, u, s.entered) - value));
            end
            band = band + 1e-10 * change / d * (model.size(n) + abs(s.x(n)));
        end
        ahead = guard(edge, s.t + 1e-6, s.x + 1e-6 * f, u, s.entered);
        behind = guard(edge, s.t - 1e-6, s.x - 1e-6 * f, u, s.entered);
        if ~(value < -band || ahead > behind || value > 1e4 * band), s.shift(edge) = band; end
    end
end

function [s, happened] = settle(model, s, u, happened)
    for count = 1:8 * (numel(model.source) + 1)
        due = 0;
        for edge = fliplr(find(model.source == s.mode))
            ready = s.shift(edge) == 0 && guard(edge, s.t, s.x, u, s.entered) >= 0;
            if ready, due = edge; end
        end
        if due == 0, return, end
        [s, happened] = taken(model, s, u, happened, due);
    end
    error('NAME: switches without end at t = %g.', s.t);
end

function [s, happened] = taken(model, s, u, happened, edge)
    s.x = reset(edge, s.t, s.x, u, s.entered);
    s.mode = model.target(edge); s.entered = s.t;
    happened(end + 1, :) = [s.t, edge, s.mode];
    s = enter(model, s, u);
end

function [y, off] = advanced(model, s, input, h)
    % one step of Dormand and Prince of order five; its error relative to the tolerance
    c = [0, 1/5, 3/10, 4/5, 8/9, 1, 1];
    a = [0, 0, 0, 0, 0, 0; 1/5, 0, 0, 0, 0, 0; 3/40, 9/40, 0, 0, 0, 0
         44/45, -56/15, 32/9, 0, 0, 0; 19372/6561, -25360/2187, 64448/6561, -212/729, 0, 0
         9017/3168, -355/33, 46732/5247, 49/176, -5103/18656, 0
         35/384, 0, 500/1113, 125/192, -2187/6784, 11/84];
    e = [71/57600; 0; -71/16695; 71/1920; -17253/339200; 22/525; -1/40];
    k = zeros(numel(s.x), 7); y = s.x;
    for i = 1:7
        y = s.x + h * k(:, 1:6) * a(i, :)';
        k(:, i) = rhs(s.t + c(i) * h, y, input(s.t + c(i) * h), s.mode);
    end
    off = max([abs(h * k * e) ./ (1e-10 * (max(abs(s.x), abs(y)) + 1e-2 * model.size)); 0]);
    if ~isfinite(off), off = 1e6; end
end
"""
