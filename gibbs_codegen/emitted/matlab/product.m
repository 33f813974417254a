function result = product(left, right)
%PRODUCT Products of matrices, page by page.
%   result = PRODUCT(left, right) has a page for each page of left and right.
    result = zeros(size(left, 1), size(right, 2), size(left, 3));
    for i = 1:size(left, 2)
        result = result + left(:, i, :) .* right(i, :, :);
    end
end
