function [q_next, v_next, A, B] = with_derivatives(method, dynamics, moves, q, v, u, h, count)
%WITH_DERIVATIVES A time step with its derivatives by q, v and u.
%   [q_next, v_next, A, B] = WITH_DERIVATIVES(method, dynamics, moves, q, v, u, h, count) takes the
%   step method(accelerate, move, q, v, h), the function dynamics(q, v) of the acceleration and its
%   derivatives, and moves, a cell with the function move(q, displacement) and, unless moves are
%   sums, the function of its derivatives. A step is linear in velocities and accelerations, so it
%   goes with columns of derivatives beside them.
    size_v = size(v, 1);
    size_u = size(u, 1);
    identity = [eye(size_v), zeros(size_v, size_v + size_u)];
    start = struct('value', q .* ones(1, count), 'columns', repmat(identity, [1, 1, count]));
    velocity = reshape(v .* ones(1, count), size_v, 1, count);
    v_columns = repmat(circshift(identity, size_v, 2), [1, 1, count]);
    accelerate = @(q, v) accelerations(dynamics, q, v);
    move = @(q, displacement) moved(moves, q, displacement);
    [q, v] = method(accelerate, move, start, [velocity, v_columns], reshape(h, 1, 1, []));
    q_next = q.value;
    v_next = first(v);
    rows = [q.columns; v(:, 2:end, :)];
    A = rows(:, 1:2 * size_v, :);
    B = rows(:, 2 * size_v + 1:end, :);
end

function a = accelerations(dynamics, q, v)
    [acceleration, by_q, by_v, by_u] = dynamics(q.value, first(v));
    columns = page_product(by_q, q.columns) + page_product(by_v, v(:, 2:end, :));
    own = size(columns, 2) - size(by_u, 2) + 1;
    columns(:, own:end, :) = columns(:, own:end, :) + by_u;
    a = [reshape(acceleration, size(v, 1), 1, size(v, 3)), columns];
end

function q = moved(moves, q, displacement)
    columns = displacement(:, 2:end, :);
    if numel(moves) > 1
        [by_q, by_displacement] = moves{2}(q.value, first(displacement));
        q.columns = page_product(by_q, q.columns) + page_product(by_displacement, columns);
    else
        q.columns = q.columns + columns;
    end
    q.value = moves{1}(q.value, first(displacement));
end

function column = first(columns)
    column = reshape(columns(:, 1, :), size(columns, 1), size(columns, 3));
end

function product = page_product(left, right)
    product = zeros(size(left, 1), size(right, 2), size(left, 3));
    for i = 1:size(left, 3)
        product(:, :, i) = left(:, :, i) * right(:, :, i);
    end
end
