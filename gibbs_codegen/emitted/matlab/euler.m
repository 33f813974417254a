function [q, v] = euler(accelerate, move, q, v, h)
%EULER A time step of the semi-implicit Euler method.
%   [q, v] = EULER(accelerate, move, q, v, h) takes the accelerations accelerate(q, v), the
%   coordinates move(q, displacement) after a displacement, and the length h of the step.
    v = v + h .* accelerate(q, v);
    q = move(q, h .* v);
end
