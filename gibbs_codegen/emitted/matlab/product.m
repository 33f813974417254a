function result = product(left, right)
%PRODUCT The products of matrices, page by page.
    result = zeros(size(left, 1), size(right, 2), size(left, 3));
    for i = 1:size(left, 3)
        result(:, :, i) = left(:, :, i) * right(:, :, i);
    end
end
