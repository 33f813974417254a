function check_constants(total_mass, constants)
%CHECK_CONSTANTS Refuse constants of parameters with which nothing can be computed.
%   CHECK_CONSTANTS(total_mass, constants) takes the mass of the whole robot, and the constants.
    if ~(total_mass > 0) || ~all(isfinite(constants))
        error('gibbs_codegen:parameter', ['these parameters leave an acceleration ' ...
            'undetermined, or are too large or too small to compute with: look for masses ' ...
            'and inertias that are zero or negative']);
    end
end
