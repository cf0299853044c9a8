-- Temperature and humidity of the air from a thermometer and a hygrometer that lag, row by row, with uncertainties.
--
-- Written by `shockrig onboard` from @PROFILE@. Lua 5.3, numbers of 32 or 64 bits. README.md says what it can and cannot.
--
--   local shock = require("shock_correct")
--   local state = shock.begin()
--   local air = shock.step(state, {time_ms = 100, temperature_c = 20.1, humidity_percent = 45.2})
--   air.temperature_c, air.temperature_uncertainty_k, air.humidity_percent, air.humidity_uncertainty_percent (nil: none)
--
-- A row may also hold airspeed_m_s, pressure_hpa and die_temperature_c; what is missing is nil. time_ms is an integer.
local shock = {MISSING = 1, REPEATED = 2, IMPLAUSIBLE = 4, OUTSIDE = 8, AS_READ = 16}

--@TABLES@

local WALK, TURBULENT, AIR, FILTERS = 2, 3, 5, 4
local WEAK, STRONG, BENDING, DOOR = 1, 2, 3, 4
local STRENGTH, BEND = {@TURBULENCE@}, {@BENDS@}
local RATE, VARIANCE = {@RATES@}, {@OU_VARIANCES@}
local INFINITE = math.huge
local exp, log, sqrt, abs, min, max, floor = math.exp, math.log, math.sqrt, math.abs, math.min, math.max, math.floor

local function within(x, low, high) return max(min(x, high), low) end
local function length(a, b) return sqrt(a * a + b * b) end
local function holds(x, low, high) return x ~= nil and x >= low and x <= high end

local function saturation(temperature_c)
  local t = 1.0 - 373.15 / (temperature_c + 273.15)
  return 1013.25 * exp(t * (13.3185 + t * (-1.9760 + t * (-0.6445 - 0.1299 * t))))
end

local function steepness(temperature_c)
  return log(saturation(temperature_c + 0.5) / saturation(temperature_c - 0.5))
end

local function look_up(from, temperature_c, airspeed, pressure)
  local wanted = {temperature_c, log(max(airspeed, @LEAST_AIRSPEED@)), log(pressure)}
  local left, place, out = {}, {}, {}
  for a = 1, 3 do
    local axis, i = from.axes[a], 1
    place[a] = 0.0
    if #axis > 1 then
      while i + 1 < #axis and wanted[a] >= axis[i + 1] do i = i + 1 end
      place[a] = within((wanted[a] - axis[i]) / (axis[i + 1] - axis[i]), 0.0, 1.0)
    end
    left[a] = i - 1
  end
  for c = 1, from.columns do out[c] = 0.0 end
  for corner = 0, 7 do
    local share, at, there = 1.0, 0, true
    for a = 1, 3 do
      local upper, count = (corner >> (a - 1)) & 1, #from.axes[a]
      if upper == 1 and count == 1 then there = false end
      share = share * (upper == 1 and place[a] or 1.0 - place[a])
      at = at * count + left[a] + upper
    end
    if there and share ~= 0.0 then
      for c = 1, from.columns do out[c] = out[c] + share * from.values[at * from.columns + c] end
    end
  end
  return out
end

local function hold(x)
  if x < 0.1 then
    local rest = 1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0))
    return x * (1.0 - x / 2.0 * rest), x / 2.0 * rest
  end
  local gone = 1.0 - exp(-x)
  return gone, 1.0 - gone / x
end

local function strengths(b)
  local square = {}
  for f = 1, FILTERS do
    local own = f == DOOR and b.d.door * b.unit or b.middle * STRENGTH[f]
    square[f] = own * own
  end
  return square
end

local function possible(b, strength) return within(strength, b.d.lowest * b.unit, b.d.highest * b.unit) end

local function bends(b)
  local square = {}
  for f = 1, FILTERS do
    local own = BEND[f] * (f < BENDING and b.middle * STRENGTH[f] or b.d.door * b.unit)
    square[f] = own * own
  end
  return square
end

-- The middle strength, and how unsure it is, by the probabilities of all that are weighed.
local function settle(b)
  local ln, mean, unsure = b.d.ln_strengths, 0.0, 0.0
  for k = 1, #ln do mean = mean + b.chance[k] * ln[k] end
  for k = 1, #ln do unsure = unsure + b.chance[k] * exp(ln[k] - mean) end
  b.middle, b.unsure = possible(b, b.usual * exp(mean)), unsure
end

-- How likely a reading is at each strength: `off` what the filters expected, whose variances without its noise are
-- `own`; between the first two straight lines over ln of the strength.
local function weigh(b, off, own, noise_variance)
  local apart, shift, low = log(STRENGTH[STRONG] / STRENGTH[WEAK]), log(b.middle / b.usual), INFINITE
  local weak, strong = max(own[WEAK], @LEAST_VARIANCE@), max(own[STRONG], @LEAST_VARIANCE@)
  local power, between = within(log(strong / weak) / apart, 0.0, 2.0), sqrt(weak) * sqrt(strong)
  local ln, cost, variance, sum = b.d.ln_strengths, {}, {}, 0.0
  for k = 1, #ln do
    local over = ln[k] - shift
    local away = off[WEAK] + within(0.5 + over / apart, 0.0, 1.0) * (off[STRONG] - off[WEAK])
    variance[k] = noise_variance + between * exp(power * over)
    cost[k] = 0.5 * away * away / variance[k]
    low = min(low, cost[k])
  end
  for k = 1, #ln do
    b.chance[k] = b.chance[k] * exp(max(low - cost[k], -@MOST_UNLIKELY@)) / sqrt(variance[k])
    sum = sum + b.chance[k]
  end
  for k = 1, #ln do b.chance[k] = b.chance[k] / sum end
  settle(b)
end

local function wobble(b, step_s)
  local sum = 0.0
  for i = 1, TURBULENT do sum = sum + VARIANCE[i] * (hold(RATE[i] * step_s)) end
  return b.middle * sqrt(sum)
end

local function packed(i, j)
  if i < j then i, j = j, i end
  return i * (i - 1) // 2 + j
end

local function carried(b, m, x, y)
  local d, before = b.d, x[1]
  y[1] = x[1] + m.step_s * x[2]
  y[2] = x[2]
  local after = y[1]
  for i = 1, TURBULENT do
    before = before + x[WALK + i]
    y[WALK + i] = m.gone[i] * x[WALK + i]
    after = after + y[WALK + i]
  end
  for i = 1, d.modes do y[AIR + i] = m.decay[i] * x[AIR + i] + m.old[i] * before + m.new[i] * after end
  if d.passing then
    local n, s = d.size, m.swing
    y[n - 1], y[n] = s[1] * x[n - 1] + s[2] * x[n], s[3] * x[n - 1] + s[4] * x[n]
  end
end

local function spread(b, p, on)
  local n, out, total = b.d.size, {}, 0.0
  for i = 1, n do
    local sum = 0.0
    for j = 1, n do
      if on[j] ~= 0.0 then sum = sum + p[packed(i, j)] * on[j] end
    end
    out[i] = sum
    total = total + on[i] * sum
  end
  return total, out
end

local function dot(a, b, n)
  local sum = 0.0
  for i = 1, n do sum = sum + a[i] * b[i] end
  return sum
end

local function direction(b, weight, slope, gone)
  local d, on = b.d, {}
  for i = 1, d.size do on[i] = 0.0 end
  if weight then
    for i = 1, d.modes do on[AIR + i] = weight[i] end
  else
    on[1], on[2] = 1.0, slope
    for i = 1, TURBULENT do on[WALK + i] = gone[i] end
  end
  if d.passing then on[d.size] = 1.0 end
  return on
end

-- Mean and variance over the filters, `added` to each; of each how far its mean is off that of all, and its variance.
local function together(b, on, added)
  local all, total, off, variance, n = 0.0, 0.0, {}, {}, b.d.size
  for f = 1, FILTERS do
    off[f] = dot(on, b.mean[f], n)
    all = all + b.likely[f] * off[f]
  end
  for f = 1, FILTERS do
    variance[f] = b.unsure * (max(spread(b, b.p[f], on), 0.0) + (added and added[f] or 0.0))
    off[f] = off[f] - all
    total = total + b.likely[f] * (variance[f] + off[f] * off[f])
  end
  return all, total, off, variance
end

local function erf(x)
  local twice = exp(-2.0 * x * (@ERF@ + @ERF_BEND@ * x * x))
  return (1.0 - twice) / (1.0 + twice)
end

-- Half width of the interval in which @CONFIDENCE@ of a mixture of normal distributions lies: Newton's steps, and halves
-- where they leave what is known of it.
local function half_width(b, off, variance)
  local deviation, low, high, sharp = {}, 0.0, 0.0, 0.0
  for f = 1, FILTERS do
    deviation[f] = sqrt(2.0 * max(variance[f], @LEAST_VARIANCE@))
    high = max(high, abs(off[f]) + 2.0 * deviation[f])
    sharp = sharp + 2.0 * b.likely[f] / (deviation[f] * deviation[f])
  end
  local width = min(@NORMAL_WIDTH@ / sqrt(sharp), high)
  for _ = 1, @WIDTH_STEPS@ do
    local inside, slope, last = 0.0, 0.0, width
    for f = 1, FILTERS do
      local s, p = deviation[f], 0.5 * b.likely[f]
      for _, place in ipairs({width - off[f], width + off[f]}) do
        local x = within(place / s, -@ERF_ENDS@, @ERF_ENDS@)
        local e = erf(x)
        inside = inside + p * e
        slope = slope + p * (1.0 - e * e) * (@ERF@ + 3.0 * @ERF_BEND@ * x * x) / s
      end
    end
    if inside < @CONFIDENCE@ then low = width else high = width end
    width = width + (@CONFIDENCE@ - inside) / max(slope, 1e-12)
    if not (width >= low and width <= high) then width = 0.5 * (low + high) end
    if abs(width - last) <= @WIDTH_SETTLED@ * width then break end
  end
  return width
end

-- The air so long after the last reading, its variance, and where it is `asked` that of the normal distribution whose
-- interval is as wide.
local function air_ahead(b, ahead, asked)
  local gone, extra, added, cube = {1.0, 1.0, 1.0}, @UNSEEN@, strengths(b), 0.0
  if ahead > 0.0 then
    cube = ahead * ahead * ahead / 3.0
    for i = 1, TURBULENT do
      gone[i] = exp(-RATE[i] * ahead)
      extra = extra + VARIANCE[i] * (1.0 - gone[i] * gone[i])
    end
  end
  local bend = bends(b)
  for f = 1, FILTERS do added[f] = added[f] * extra + bend[f] * cube end
  local all, total, off, variance = together(b, direction(b, nil, max(ahead, 0.0), gone), added)
  if not asked then return all, total end
  local sigma = half_width(b, off, variance) / @NORMAL_WIDTH@
  return all, total, sigma * sigma
end

local function start(b, level, c)
  local d = b.d
  local wide = d.spread * b.unit * (d.spread * b.unit)
  b.usual = c.usual and possible(b, c.usual) or sqrt(d.lowest * d.highest) * b.unit
  b.chance = {}
  for k = 1, #d.before do b.chance[k] = d.before[k] end
  settle(b)
  local square, n = strengths(b), d.size
  b.mean, b.p, b.likely = {}, {}, {}
  for f = 1, FILTERS do
    local mean, p = {}, {}
    for k = 1, packed(n, n) do p[k] = 0.0 end
    for i = 1, n do
      mean[i] = (i == 1 or (i > AIR and i <= AIR + d.modes)) and level or 0.0
      p[packed(i, i)] = (i > WALK and i <= AIR) and square[f] * VARIANCE[i - WALK] or wide
    end
    if d.passing then
      p[packed(n, n)] = c.passing * c.passing
      p[packed(n - 1, n - 1)] = c.passing / c.speed * (c.passing / c.speed)
    end
    b.mean[f], b.p[f], b.likely[f] = mean, p, 1.0 / FILTERS
  end
  b.started = true
end

local function moves(step_s)
  local change, bend, bent = (hold(step_s / @CHANGE_S@)), (hold(step_s / @BENDS_S@)), (hold(step_s / @BEND_S@))
  local door, shut, move = (hold(step_s / @DOORS_S@)), (hold(step_s / @DOOR_S@)), {}
  for from = 1, FILTERS do
    move[from] = {}
    local gone, calm = 0.0, from == BENDING and 0.5 * bent or from == DOOR and 0.5 * shut or change
    for to = 1, FILTERS do
      local share = to == DOOR and door or to == BENDING and (from == DOOR and 0.0 or bend) or calm
      move[from][to] = share
      if to ~= from then gone = gone + share end
    end
    move[from][from] = 1.0 - gone
  end
  return move
end

local function mix(b, step_s)
  local move, n, share, likely, mean, p = moves(step_s), b.d.size, {}, {}, {}, {}
  for to = 1, FILTERS do
    share[to], likely[to], mean[to], p[to] = {}, 0.0, {}, {}
    for from = 1, FILTERS do
      share[to][from] = move[from][to] * b.likely[from]
      likely[to] = likely[to] + share[to][from]
    end
    local whole = 0.0
    for from = 1, FILTERS do
      share[to][from] = max(share[to][from] / likely[to] - @LEAST_SHARE@, 0.0)
      whole = whole + share[to][from]
    end
    for from = 1, FILTERS do share[to][from] = share[to][from] / whole end
    for i = 1, n do
      local first, sum = b.mean[1][i], 0.0
      for from = 2, FILTERS do sum = sum + share[to][from] * (b.mean[from][i] - first) end
      mean[to][i] = first + sum
    end
    for i = 1, n do
      for j = 1, i do
        local k, own = packed(i, j), 0.0
        for from = 1, FILTERS do
          local x = b.mean[from]
          own = own + share[to][from] * (b.p[from][k] + (x[i] - mean[to][i]) * (x[j] - mean[to][j]))
        end
        p[to][k] = own
      end
    end
  end
  b.mean, b.p, b.likely = mean, p, likely
end

local function advance(b, step_s, values, c)
  local d = b.d
  local n, modes, square, bend, added_to = d.size, d.modes, strengths(b), bends(b), {}
  local cube, half = step_s * step_s * step_s / 3.0, step_s * step_s / 2.0
  local m, own = {step_s = step_s, gone = {}, old = {}, new = {}, decay = {}}, {0.0, 0.0, 0.0}
  for i = 1, TURBULENT do
    m.gone[i] = exp(-RATE[i] * step_s)
    added_to[i] = VARIANCE[i] * (1.0 - m.gone[i] * m.gone[i])
  end
  for i = 1, modes do
    local gone
    gone, m.new[i] = hold(exp(values[modes + i]) * step_s)
    m.old[i], m.decay[i] = gone - m.new[i], 1.0 - gone
  end
  if d.passing then
    local speed = c.speed
    local w, r, v = speed * step_s, 1.0 / (speed * speed), c.passing * c.passing
    local fade = exp(-w)
    local s = {fade * (1.0 + w), fade * step_s, -fade * speed * w, fade * (1.0 - w)}
    m.swing = s
    own[1] = v * max(r - (s[1] * s[1] * r + s[2] * s[2]), 0.0)
    own[2] = -v * (s[3] * s[1] * r + s[4] * s[2])
    own[3] = v * max(1.0 - (s[3] * s[3] * r + s[4] * s[4]), 0.0)
  end
  for f = 1, FILTERS do
    local mean, p, work, x, y, both = b.mean[f], b.p[f], {}, {}, {}, bend[f] * half
    local q, total = {bend[f] * cube, bend[f] * step_s}, bend[f] * cube
    for i = 1, TURBULENT do
      q[WALK + i] = square[f] * added_to[i]
      total = total + q[WALK + i]
    end
    carried(b, m, mean, x)
    b.mean[f] = x
    for i = 1, n do work[i] = {} end
    local column = {}
    for j = 1, n do
      for i = 1, n do column[i] = p[packed(i, j)] end
      carried(b, m, column, y)
      for i = 1, n do work[i][j] = y[i] end
    end
    for i = 1, n do
      carried(b, m, work[i], y)
      for j = 1, i do
        local added = 0.0
        if i > AIR and i <= AIR + modes then
          local into = m.new[i - AIR]
          if j == 2 then
            added = into * both
          elseif j <= AIR then
            added = into * q[j]
          else
            added = into * m.new[j - AIR] * total
          end
        elseif i <= AIR and i == j then
          added = q[i]
        elseif i == 2 and j == 1 then
          added = both
        end
        if i > AIR + modes and j > AIR + modes then added = own[i + j - 2 * (AIR + modes) - 1] end
        p[packed(i, j)] = y[j] + added
      end
    end
  end
end

local function predict(b, step_s, values, c)
  local parts = floor(within(step_s / b.d.straight_s + 0.5, 1.0, @MOST_PARTS@))
  if c.usual then b.usual = possible(b, c.usual) end
  local another = hold(step_s / @CHANGE_S@)
  for k = 1, #b.chance do b.chance[k] = b.chance[k] + another * (b.d.before[k] - b.chance[k]) end
  settle(b)
  mix(b, step_s)
  for _ = 1, parts do advance(b, step_s / parts, values, c) end
end

local function update(b, on, reading, noise_variance)
  local cost, off, own, low, sum, n = {}, {}, {}, INFINITE, 0.0, b.d.size
  for f = 1, FILTERS do
    local mean, p = b.mean[f], b.p[f]
    local pc
    own[f], pc = spread(b, p, on)
    own[f] = max(own[f], 0.0)
    local s, v = own[f] + noise_variance, reading - dot(on, mean, n)
    off[f] = v
    local gain, left = {}, {}
    for i = 1, n do
      -- no correlation is above one, whatever rounding has made of it
      local bound = sqrt(max(p[packed(i, i)], 0.0) * s)
      pc[i] = within(pc[i], -bound, bound)
      gain[i] = pc[i] / s
    end
    -- Joseph's form: what rounding leaves of a large variance in the direction of the reading is taken out again
    for i = 1, n do
      left[i] = 0.0
      for j = 1, n do
        if on[j] ~= 0.0 then left[i] = left[i] + (p[packed(i, j)] - gain[i] * pc[j]) * on[j] end
      end
    end
    for i = 1, n do
      mean[i] = mean[i] + gain[i] * v
      for j = 1, i do
        local k = packed(i, j)
        p[k] = (p[k] - gain[i] * pc[j]) + (noise_variance * gain[i] - left[i]) * gain[j]
      end
      local k = packed(i, i)
      p[k] = max(p[k], @LEAST_VARIANCE@)
    end
    cost[f] = 0.5 * (v * v / s + log(s))
    low = min(low, cost[f])
  end
  for f = 1, FILTERS do
    b.likely[f] = b.likely[f] * exp(max(low - cost[f], -@MOST_UNLIKELY@))
    sum = sum + b.likely[f]
  end
  local whole = 0.0
  for f = 1, FILTERS do
    b.likely[f] = max(b.likely[f] / sum, @LEAST_LIKELY@)
    whole = whole + b.likely[f]
  end
  for f = 1, FILTERS do b.likely[f] = b.likely[f] / whole end
  weigh(b, off, own, noise_variance)
end

local DECIMAL_STEPS = {@DECIMAL_STEPS@, 0.0} -- the last: written in none of them

-- before readings have changed, which in calm air they do not, the step that they are written in
local function resolution(g) return g.changes >= @FEWEST_CHANGES@ and g.step or DECIMAL_STEPS[g.decimals] end

local function written_in(reading, step)
  return abs(reading - step * math.floor(reading / step + 0.5)) <= @WRITTEN_WITHIN@
end

local function is_coarse(d, g) return resolution(g) > @COARSE@ * d.noise end
local function white(m) return within((m[1] / max(m[2], 1e-9) - @WHITE@ + @SOFT@) / @SOFT@, 0.0, 1.0) end
local function usual_noise(m) return within(1.0 + white(m) * (m[1] - 1.0), @LEAST_NOISE@, @MOST_NOISE@) end

local function bursting(g)
  local times = g.burst[1] / usual_noise(g.usual)
  return 1.0 + within(times / @LOUD@ - 1.0, 0.0, 1.0) * white(g.burst) * (times - 1.0)
end

local function fresh_guard()
  return {
    step = 0.0, smallest = INFINITE, smallest_before = INFINITE, often = 0.0, width = 0.0, burst = {1.0, 1.0},
    usual = {1.0, 1.0}, changes = 0, stays = 0, equal = 0, unused = 0, refused = 0,
    decimals = 1
  }
end

local function differences(d, g, reading, alike)
  if d.share > @MOST_SHARE@ or not g.third then return end
  local noise = length(length(d.noise, resolution(g) / 3.4641016), alike)
  local third = abs((reading - g.last) - 2.0 * (g.last - g.before) + (g.before - g.third)) / (@THIRD@ * noise)
  local size = {third, abs(reading - g.last) / (@FIRST@ * noise)}
  for i = 1, 2 do
    g.burst[i] = g.burst[i] + (min(size[i], @MOST_DIFFERENCE@) - g.burst[i]) / @BURST_ROWS@
    g.usual[i] = g.usual[i] + (min(size[i], @MOST_DIFFERENCE@) - g.usual[i]) / @NOISE_ROWS@
  end
end

local function believed(d, g, reading, alike)
  while g.decimals <= @DECIMAL_COUNT@ and not written_in(reading, DECIMAL_STEPS[g.decimals]) do
    g.decimals = g.decimals + 1
  end
  if not g.last then
    g.last, g.anchor = reading, reading
    return false
  end
  local change = abs(reading - g.last)
  local same = change == 0.0
  g.equal = same and g.equal + 1 or 0
  g.often = g.often + ((same and 1.0 or 0.0) - g.often) / @REPEATS_ROWS@
  if not same then
    differences(d, g, reading, alike)
    g.changes = g.changes + 1
    g.width = g.width + (change - g.width) / min(g.changes, @REPEATS_ROWS@)
    g.smallest = min(g.smallest, change)
    if g.changes % @CHANGES_KEPT@ == 0 then g.smallest_before, g.smallest = g.smallest, INFINITE end
    g.step = min(g.smallest, g.smallest_before)
    if g.step == INFINITE then g.step = change end
  end
  if abs(reading - g.anchor) <= @LEVELS@ * resolution(g) then
    g.stays = g.stays + 1
  else
    g.anchor, g.stays = reading, 0
  end
  g.third, g.before, g.last = g.before, g.last, reading
  local step = resolution(g)
  if not same or step >= 1.5 * d.noise or g.changes < @FEWEST_CHANGES@ then return false end
  local by_chance = min(step * @MEAN_SIZE@ / (2.5066283 * max(g.width, 1e-9)), 1.0)
  return g.equal > 1 or g.often > @TIMES_BY_CHANCE@ * max(by_chance, 1.0 / @REPEATS_ROWS@)
end

local function kept_by_chance(d, g)
  local step = resolution(g)
  if step == 0.0 then return INFINITE end
  local x = @LEVELS_PLAIN@ * step / (d.noise * 1.4142136)
  local share = erf(within(x, -@ERF_ENDS@, @ERF_ENDS@))
  if not (share > 0.0 and share < 0.999) then return INFINITE end
  return max(math.ceil(@LN_BY_CHANCE@ / log(share)), 5)
end

local function judge(d, g, reading, expected, open_to, alike)
  local v = {usable = false, missing = false, repeated = false, implausible = false, restart = false, variance = 0.0}
  if not reading then
    v.missing = true
    g.unused = g.unused + 1
    return v
  end
  local away = abs(reading - expected)
  local usual = length(d.noise, resolution(g) / 3.4641016) * usual_noise(g.usual)
  local share = 1.0 - (1.0 - min(d.share, 0.999)) ^ (g.unused + 1)
  local farthest = d.swing * share + length(@LONE@ * usual, @SPIKE@ * resolution(g)) + 4.0 * open_to
  v.implausible = not holds(reading, d.low, d.high)
  if not v.implausible and away > max(@LEAST_JUMP@, @LONE@ * usual + 4.0 * open_to) then
    for _, code in ipairs(d.codes) do
      if abs(reading - code) <= @NEAR_CODE@ then v.implausible = true end
    end
  end
  if not v.implausible and away > farthest then
    g.refused = g.refused + 1
    if g.refused >= @LASTING@ then
      for key in pairs(g) do g[key] = nil end
      for key, value in pairs(fresh_guard()) do g[key] = value end
      believed(d, g, reading, 0.0)
      v.usable, v.restart, v.variance = true, true, d.noise * d.noise
      return v
    end
    v.implausible = true
  end
  if v.implausible then
    g.unused = g.unused + 1
    return v
  end
  g.refused = 0
  local capped = reading >= d.ceiling - 0.5 * resolution(g)
  v.repeated = believed(d, g, reading, alike)
  local step, noise = resolution(g), d.noise * usual_noise(g.usual) * bursting(g)
  v.variance = noise * noise + step * step / 12.0 * (is_coarse(d, g) and 1.0 + g.equal or 1.0)
  if g.stays >= kept_by_chance(d, g) then v.repeated = true end
  v.usable = not capped and not v.repeated
  g.unused = v.usable and 0 or g.unused + 1
  return v
end

local function take(b, here, step_s, reading, air_c, own_c, unit, c)
  local d, found = b.d, {}
  b.unit = unit
  local airspeed, pressure = here.airspeed or @REFERENCE_AIRSPEED@, here.pressure or 1013.25
  local values = look_up(d.response, air_c, airspeed, pressure)
  local readout = look_up(d.readout, own_c, airspeed, pressure)
  found.readout = readout[3]
  found.relative = length(values[2 * d.modes + 1], here.airspeed and 0.0 or d.unsure_of_airspeed)
  local on, shown, open_to = direction(b, values), reading, 0.0
  b.since_used_s, b.since_read_s = b.since_used_s + step_s, b.since_read_s + step_s
  if b.started then
    predict(b, step_s, values, c)
    local expected, variance = together(b, on)
    shown, open_to = (expected / unit - readout[1]) / readout[2], sqrt(variance) / (readout[2] * unit)
  end
  local judged = judge(d, b.guard, reading, shown, open_to, c.alike)
  found.judged = judged
  if judged.usable or judged.repeated then b.since_read_s = 0.0 end
  if judged.usable then
    local level, scale = (readout[1] + readout[2] * reading) * unit, readout[2] * unit
    b.since_used_s = 0.0
    if judged.restart or not b.started then start(b, level, c) end
    update(b, on, level, judged.variance * scale * scale)
  end
  found.step = is_coarse(d, b.guard) and resolution(b.guard) * readout[2] * unit or 0.0
  if not b.started then return found end
  found.air, found.variance, found.stated = air_ahead(b, d.delay_s, true)
  found.clean, found.slow = 0.0, {}
  for i = 1, d.modes do
    local lag = 0.0
    for f = 1, FILTERS do lag = lag + b.likely[f] * b.mean[f][AIR + i] end
    found.clean = found.clean + values[i] * lag
    if i > d.modes - d.slow then found.slow[i - d.modes + d.slow] = lag end
  end
  b.shown = found.clean
  if d.passing then
    for f = 1, FILTERS do b.shown = b.shown + b.likely[f] * b.mean[f][d.size] end
  end
  return found
end

local function common(d, found)
  local total = (found.relative * (found.air - found.clean)) ^ 2
  for i = 1, d.slow do total = total + (d.slow_uncertainty[i] * (found.air - found.slow[i])) ^ 2 end
  return sqrt(total)
end

local function is_stale(b, found)
  return b.since_used_s > @LONGEST_FILL@ and not (found.judged.repeated and b.since_used_s <= @LONGEST_REPEAT@)
end

local function said(v)
  return (v.missing and shock.MISSING or 0) + (v.repeated and shock.REPEATED or 0)
    + (v.implausible and shock.IMPLAUSIBLE or 0)
end

local function resolved_rate(b)
  local low, high = log(b.d.lowest), log(b.d.highest)
  local at = within((log(b.middle) - low) / (high - low), 0.0, 1.0) * (@STRENGTHS@ - 1)
  local i = min(floor(at), @STRENGTHS@ - 2)
  local rates = b.d.ln_resolved
  return exp(rates[i + 1] + (at - i) * (rates[i + 2] - rates[i + 1]))
end

local function fresh(d)
  return {d = d, started = false, since_used_s = INFINITE, since_read_s = INFINITE, guard = fresh_guard(), middle = 1.0,
    unit = 1.0}
end

local PLAIN = {passing = 0.0, speed = 1.0, alike = 0.0}

function shock.begin()
  return {bead = fresh(BEAD), film = fresh(FILM), strays = 0}
end

local function in_order(state, time_ms)
  local ahead = state.time_ms and time_ms - state.time_ms
  if ahead and ahead <= 0 then
    local on = state.stray_ms and time_ms - state.stray_ms
    state.strays = on and on > 0 and on <= @LONGEST_MS@ and state.strays + 1 or 1
    state.stray_ms = time_ms
    if state.strays < @FEWEST_ROWS@ then return nil end
  end
  local begins = not ahead or ahead <= 0 or ahead > @LONGEST_MS@
  state.strays, state.stray_ms, state.time_ms = 0, nil, time_ms
  if begins then
    state.bead, state.film, state.last_c, state.before_c = fresh(BEAD), fresh(FILM), nil, nil
    return 0.0
  end
  return ahead * 0.001
end

local function humid(state, row, step_s, bead, air)
  local b, warmth = state.film, state.bead
  -- where the bead tells how warm the film is, its reading without the noise
  local die_c = BESIDE_BEAD and warmth.shown or not BESIDE_BEAD and row.die_temperature_c or nil
  if not warmth.started then
    air.humidity_flags = shock.MISSING
    return
  end
  local coldest, warmest = b.d.low_c - @FAR_C@, b.d.high_c + @FAR_C@
  local then_c = within((air_ahead(warmth, warmth.d.delay_s - b.d.delay_s)), coldest, warmest)
  local now_c, sigma = within(bead.air, coldest, warmest), sqrt(bead.stated)
  local read = holds(die_c, -100.0, 150.0)
  die_c = read and within(die_c, coldest, warmest) or nil
  local at_die = DIE_SHARE > 0.0 and read
  local own = saturation(at_die and then_c + DIE_SHARE * (die_c - then_c) or then_c)
  local held = BY_ACTIVITY and own or saturation(20.0)
  local back, bend, c = held / saturation(now_c), 0.0, {passing = 0.0, speed = resolved_rate(warmth), alike = 0.0}
  if state.before_c then bend = abs((now_c - state.last_c) - (state.last_c - state.before_c)) / 2.0 end
  state.before_c, state.last_c = state.last_c, now_c
  local level = b.started and b.shown or row.humidity_percent and row.humidity_percent * own / held
  if level then
    c.usual = @VAPOUR@ * abs(level) * warmth.middle
    if not at_die and not BY_ACTIVITY then
      c.passing = abs(level) * steepness(now_c) * length(sqrt(bead.variance), bend)
      c.alike = abs(level) * held / own * steepness(now_c) * wobble(warmth, @PERIOD_STEP@)
    end
  end
  local reading = warmth.since_read_s <= @UNREAD@ and row.humidity_percent or nil
  local found = take(b, state, step_s, reading, now_c, read and die_c or now_c, own / held, c)
  air.humidity_flags = said(found.judged)
  if not b.started or is_stale(b, found) then return end
  local value, readout = found.air * back, length(found.readout, b.d.left)
  local shared = common(b.d, found) * back
  local total = max(found.stated, found.step * found.step / 12.0) * back * back + shared * shared
  if at_die or BY_ACTIVITY then total = total + (value * steepness(now_c) * sigma) ^ 2 end
  if not holds(now_c, b.d.low_c, b.d.high_c) then
    air.humidity_flags = air.humidity_flags + shock.OUTSIDE
    if not (found.judged.usable or found.judged.repeated) then return end
    air.humidity_flags = air.humidity_flags + shock.AS_READ
    local away = row.humidity_percent - value
    air.humidity_percent = row.humidity_percent
    total = sqrt(total + readout * readout + away * away)
    air.humidity_uncertainty_percent = min(total, max(air.humidity_percent, 100.0 - air.humidity_percent))
    return
  end
  value = within(value, 0.0, 100.0)
  air.humidity_percent = value
  air.humidity_uncertainty_percent = length(min(sqrt(total), max(value, 100.0 - value)), readout)
end

local function number(x)
  if x == nil or x ~= x or x == INFINITE or x == -INFINITE then return nil end
  return x
end

function shock.step(state, row)
  local air = {temperature_flags = shock.IMPLAUSIBLE, humidity_flags = shock.IMPLAUSIBLE}
  local step_s = in_order(state, row.time_ms)
  if not step_s then return air end
  local here = {
    temperature_c = number(row.temperature_c), humidity_percent = number(row.humidity_percent),
    die_temperature_c = number(row.die_temperature_c)
  }
  if holds(number(row.airspeed_m_s), 0.0, 150.0) then state.airspeed = row.airspeed_m_s end
  if holds(number(row.pressure_hpa), 1.0, 2000.0) then state.pressure = row.pressure_hpa end
  if holds(here.temperature_c, -100.0, 150.0) then state.reading_c = here.temperature_c end
  local b = state.bead
  local shown = b.started and b.shown or state.reading_c or 20.0
  local found = take(b, state, step_s, here.temperature_c, shown, shown, 1.0, PLAIN)
  air.temperature_flags = said(found.judged)
  if b.started and not is_stale(b, found) then
    local shared = length(common(b.d, found), length(found.readout, b.d.left))
    local value = within(found.air, -100.0, 150.0)
    air.temperature_c = value
    local own = max(found.stated, found.step * found.step / 12.0)
    air.temperature_uncertainty_k = min(sqrt(own + shared * shared), max(value + 100.0, 150.0 - value))
  end
  humid(state, here, step_s, found, air)
  return air
end

return shock
