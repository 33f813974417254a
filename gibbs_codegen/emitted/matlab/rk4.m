function [q_next, v_next] = rk4(accelerate, move, q, v, h)
%RK4 A time step of a Runge-Kutta method of fourth order.
%   [q_next, v_next] = RK4(accelerate, move, q, v, h) takes the accelerations accelerate(q, v), the
%   coordinates move(q, displacement) after a displacement, and the length h of the step.
    a1 = accelerate(q, v);
    half = move(q, h ./ 2 .* v);
    rate = v + h ./ 2 .* a1;
    a2 = accelerate(half, rate);
    place = move(q, h ./ 2 .* rate);
    rate = v + h ./ 2 .* a2;
    a3 = accelerate(place, rate);
    place = move(half, h .* (rate - v ./ 2));
    a4 = accelerate(place, v + h .* a3);
    place = move(q, h ./ 2 .* (v + h ./ 6 .* (a1 + a2 - a3)));
    q_next = move(place, h ./ 2 .* (v + h ./ 6 .* (a1 + a2 + 3 .* a3)));
    v_next = v + h ./ 6 .* (a1 + 2 .* (a2 + a3) + a4);
end
