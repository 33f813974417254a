function [count, varargout] = states(names, sizes, varargin)
%STATES Arguments of a function as columns, one for each state.
%   [count, q, v] = STATES({'q', 'v'}, {9, 9}, q, v) takes names, which errors use, the size of each
%   argument for one state, and the arguments. States go along one more axis than the size has; an
%   argument has as many of them as the others, or one that serves for all. In its column a state
%   has its entries in MATLAB's order. count is the number of states. [] serves for an argument
%   without entries.
    count = 1;
    varargout = varargin;
    for i = 1:numel(names)
        values = varargin{i};
        if ~(isnumeric(values) || islogical(values)) || ~isreal(values)
            error('gibbs_codegen:argument', '%s must be real numbers', names{i});
        end
        if prod(sizes{i}) == 0 && isequal(values, [])
            values = zeros([sizes{i}, 1]);
        end
        given = size(values);
        given(end + 1:numel(sizes{i}) + 1) = 1;
        columns = given(end);
        if ~isequal(given, [sizes{i}, columns])
            needed = sprintf('%d x ', sizes{i});
            found = sprintf(' x %d', size(values));
            error('gibbs_codegen:argument', '%s must be %sk for k states, not %s', names{i}, ...
                needed, found(4:end));
        elseif columns ~= 1 && count ~= 1 && columns ~= count
            error('gibbs_codegen:argument', '%s has %d states, but arguments before it have %d', ...
                names{i}, columns, count);
        elseif columns ~= 1
            count = columns;
        end
        varargout{i} = reshape(double(full(values)), prod(sizes{i}), columns);
    end
end
