function values = changed_parameters(defaults, folded, changed)
%CHANGED_PARAMETERS All parameters, some of them changed.
%   values = CHANGED_PARAMETERS(defaults, folded, changed) takes structs of all parameters and of
%   those that are changed, and the names of those that are built in as zeros.
    if ~isstruct(changed) || ~isscalar(changed)
        error('gibbs_codegen:parameter', 'parameters must be one struct of numbers');
    end
    values = defaults;
    names = fieldnames(changed);
    for i = 1:numel(names)
        value = changed.(names{i});
        if any(strcmp(names{i}, folded))
            error('gibbs_codegen:parameter', ['%s is not a parameter of this module, because ' ...
                'it is zero in the robot file; generate the module with --all-parameters ' ...
                'to keep it'], names{i});
        elseif ~isfield(defaults, names{i})
            error('gibbs_codegen:parameter', ['unknown parameter %s: the function parameters ' ...
                'of this package has all names'], names{i});
        elseif ~isnumeric(value) || ~isscalar(value) || ~isreal(value) || ~isfinite(value)
            error('gibbs_codegen:parameter', '%s must be one finite real number', names{i});
        end
        values.(names{i}) = double(value);
    end
end
