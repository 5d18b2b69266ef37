function solid(questions, answers)
% SOLID  Active Bayesian perception of where and what in MATLAB and Octave.
%
%     octave-cli --path FOLDER --eval solid < case.jsonl      (FOLDER is that of this file)
%     solid('case.jsonl', 'answers.jsonl')                    (in MATLAB, and in Octave, too)
%
% After Lepora, Martinez-Hernandez and Prescott, "A SOLID case for active Bayesian perception in robot touch", 2013.
% Answers the conformance cases of this folder. It has run on Octave 7.3; of MATLAB it uses what both have.
%
% Letters are the paper's: L where classes, M what classes, K taxels, J samples of a tap, B bins. Indices count from 1
% here and from 0 in the files. Beliefs are matrices [L M] of logarithms.
  [in, out] = deal(0, 1);
  if nargin == 2
    [in, out] = deal(fopen(questions, 'r', 'n', 'UTF-8'), fopen(answers, 'w', 'n', 'UTF-8'));
    if in < 0 || out < 0, error('solid: %s or %s cannot be opened.', questions, answers); end
    closing = onCleanup(@() cellfun(@fclose, {in, out}));
  end
  text = fgetl(in);
  while ischar(text)
    if ~isempty(strtrim(text))
      line = jsondecode(text);
      line.text = text;
      if isfield(line, 'tap')
        [model, answer] = perceive(model, line);
      else
        [model, answer] = begun(line);
      end
      write(out, answer);
    end
    text = fgetl(in);
  end
end

function write(out, answer)
% One line of JSON; minus infinity and NaN become null. A field cannot be named "case" in MATLAB.
  if ~isempty(answer)
    fprintf(out, '%s\n', regexprep(jsonencode(answer), '^{"xCase"', '{"case"'));
  end
end

function values = numbers(line, key, shape)
% The array below a key. jsondecode of Octave gives one number in six as a neighbour of the double that it denotes,
% which can lie on the other side of a bin edge, and drops axes of length 1.
  list = regexp(line.text, ['"' key '"\s*:\s*([^"}]*)'], 'tokens', 'once');
  values = sscanf(regexprep(list{1}, '[\[\],\s]+', ' '), '%f');
  if numel(values) ~= prod(shape), error('solid: "%s" must hold %d numbers.', key, prod(shape)); end
  values = permute(reshape(values, fliplr(shape)), numel(shape):-1:1);
end

function [model, fitted] = begun(header)
% What is known before the first tap, from the header of a case; also the answer about training taps, if there are any.
  if header.format ~= 1 || (isfield(header, 'saturation') && ~isempty(header.saturation))
    error('solid: "format" must be 1 and "saturation" null.');
  end
  [L, M, K, J, B] = deal(header.L, header.M, header.K, header.J, header.B);
  fitted = [];
  if isfield(header, 'training')
    [edges, counts] = trained(header);
    fitted = struct('xCase', header.xCase, 'tap', 0, 'edges', edges, 'counts', counts);
  else
    edges = numbers(header, 'edges', [numel(header.edges) / (B + 1), B + 1]);
  end
  if isfield(header, 'probabilities')
    table = numbers(header, 'probabilities', [L, M, K, B]);
  else
    if isempty(fitted), counts = numbers(header, 'counts', [L, M, K, B]); end
    table = counts + header.pseudocount;
    table = table ./ sum(table, 4);  % Eq. 2
  end
  model = header;
  model.edges = repmat(edges, K / size(edges, 1), 1);
  model.trained = reshape(any(table(:, :, :) > 0, 3), L, M);
  model.log_table = log(reshape(table, L * M, K * B));  % a column for each pair of taxel and bin
  model.log_belief = log(numbers(header, 'prior', [L, M]));
  model.over = false;
  if ischar(header.power)
    roots = struct('J', J, 'JK', J * K, 'none', 1);
    model.power = 1 / roots.(header.power);
  end
end

function [edges, counts] = trained(header)
% Bins of equal width over the range of all samples, and what falls into them.
  [J, K, B, where, what] = deal(header.J, header.K, header.B, header.training.where, header.training.what);
  taps = numbers(header, 'taps', [numel(where), J, K]);
  [low, high] = deal(min(taps(:)), max(taps(:)));
  edges = [low + (high - low) * (0:B - 1) / B, high];
  counts = zeros(header.L, header.M, K, B);
  for n = 1:size(taps, 1)
    for k = 1:K
      b = bins(reshape(taps(n, :, k), J, 1), edges);
      [l, m] = deal(where(n) + 1, what(n) + 1);
      counts(l, m, k, :) = counts(l, m, k, :) + reshape(accumarray(b, 1, [B, 1]), 1, 1, 1, B);
    end
  end
end

function b = bins(samples, edges)
% Bins of a column of samples; only inner edges are looked at, so that samples outside go to the end bins.
  b = 1 + sum(samples >= edges(2:end - 1), 2);
end

function [model, answer] = perceive(model, line)
% The answer to a tap; nothing after an impossible one.
  answer = [];
  if model.over, return; end
  [L, M, K] = deal(model.L, model.M, model.K);
  belief = shifted(model.log_belief, model.trained, line.move, model.border);
  samples = numbers(line, 'samples', [model.J, K]);
  cells = zeros(model.J, K);
  for k = 1:K
    cells(:, k) = k + K * (bins(samples(:, k), model.edges(k, :)) - 1);
  end
  log_likelihood = reshape(model.power * sum(model.log_table(:, cells(:)), 2), L, M);  % Eq. 1
  joint = belief + log_likelihood;
  log_evidence = log_sum(joint);  % Eq. 4
  if log_evidence == -Inf
    model.over = true;
    answer = struct('xCase', model.xCase, 'tap', line.tap, 'error', 'zero_evidence');
    return;
  end
  model.log_belief = joint - log_evidence;  % Eq. 3
  posterior = exp(model.log_belief);
  [where, what] = deal(sum(posterior, 2), sum(posterior, 1));  % Eq. 5, 6
  decisions = arrayfun(@(threshold) decided(what, threshold), model.thresholds);  % Eq. 7
  move = model.fixation - decided(where, model.theta_x);  % Eq. 8, 10
  move(isnan(move)) = 0;
  answer = struct('xCase', model.xCase, 'tap', line.tap, 'log_likelihood', log_likelihood, ...
                  'log_evidence', log_evidence, 'posterior', posterior, 'where', where, 'what', what, ...
                  'decisions', decisions, 'move', move);
end

function class = decided(marginal, threshold)
% The class with the largest marginal, the first of equals, counted from 0; NaN if that is not above the threshold.
  [top, best] = max(marginal);
  class = NaN;
  if threshold < 1 && top > threshold, class = best - 1; end
end

function new = shifted(old, trained, d, border)
% Eq. 9: log belief after a move by d.
  [L, M] = size(old);
  new = -Inf(L, M);
  lost = -Inf(1, M);
  vacated = false(L, M);
  for m = 1:M
    to = landing(trained(:, m), d, border);
    for l = find(to)'
      new(to(l), m) = log_sum([new(to(l), m), old(l, m)]);
    end
    lost(m) = log_sum(old(to == 0, m));
    vacated(:, m) = trained(:, m) & ~ismember((1:L)', to);
  end
  switch border
    case 'uniform'
      fill = repmat(log_sum(lost) - log(nnz(vacated)), 1, M);
    case 'uniform_what'
      fill = lost - log(sum(vacated, 1));
    case 'prior'
      fill = repmat(-log(nnz(trained)), 1, M);
    otherwise
      fill = -Inf(1, M);
  end
  fill = repmat(fill, L, 1);
  new(vacated) = fill(vacated);
  new = new - log_sum(new);
end

function to = landing(trained, d, border)
% Eq. 9 for one object: where belief about each place comes to lie; 0 where it is lost, and for untrained places.
  L = numel(trained);
  places = find(trained);
  to = (1:L)' + d;
  if strcmp(border, 'circular')
    to = 1 + mod(to - 1, L);
  elseif strcmp(border, 'clamp')
    cut = min(max(to, 1), L);
    for l = places'
      [~, nearest] = min(abs(places - cut(l)));
      to(l) = places(nearest);
    end
  end
  to(~(trained & ismember(to, places))) = 0;
  if strcmp(border, 'circular')
    to(trained & to == 0) = setdiff(places, to);
  end
end

function total = log_sum(logs)
  top = max([logs(:); -Inf]);
  total = top;
  if top > -Inf, total = top + log(sum(exp(logs(:) - top))); end
end
