" Vim syntax of Koord, made by editors/generate.py: change that
if exists('b:current_syntax')
  finish
endif

syn keyword koordSection agent allread allwrite assume def eff enum eventually init invariant local param pre urgent using
syn keyword koordStatement atomic break elif else for if pass repeat return stop trystop
syn keyword koordOperator and exists forall implies in leadsto not or
syn keyword koordBoolean False True false true
syn keyword koordName Nsys delta numAgents pi pid result stopped
syn keyword koordType List Map Point Queue Set bool boolean float int pos stream string
syn keyword koordModule Clock Log Motion MotionWithScan Radio
syn match koordSection /\v<(actuators|ensures|environment|requires|sensors)>\ze\s*:/
syn match koordSection /\v<(fun|adt|contract)>\ze\s+\w/
syn match koordModifier /\v<extern(\s+fresh)?>|<at\s+round>/
syn match koordBuiltin /\v<(abs|add|all|any|append|assign|choose|clamp|contains|float|keys|len|length|max|min|pop|pos|ran|remove|toList)>\ze\s*\(/
syn match koordLibrary /\v<(allAssigned|atan2|cos|distance|findObs|findPath|getAvailableNextTask|getNeighbors|getPathFromTask|merge|mid|midpoint|norm|pathIsClear|pathsClear|pickFrontierPos|pos3d|scanToMap|sin|sqrt|willCollide)>\ze\s*\(/
syn match koordSign /\V<<\|->\|++\|--\|==\|!=\|<=\|>=\|&&\|||\|+\|-\|*\|\/\|%\|<\|>\|=\|!\|@\|'/
syn match koordNumber /\v<\d+(\.\d+)?([eE][+-]?\d+)?>/
syn match koordEvent /^\h\w*\ze\s*:/
syn region koordString start=/"/ skip=/\\./ end=/"\|$/
syn match koordComment /\(#\|\/\/\).*$/ contains=@Spell

hi def link koordSection Structure
hi def link koordStatement Statement
hi def link koordOperator Operator
hi def link koordBoolean Boolean
hi def link koordName Identifier
hi def link koordType Type
hi def link koordModule Include
hi def link koordModifier StorageClass
hi def link koordBuiltin Function
hi def link koordLibrary Function
hi def link koordSign Operator
hi def link koordNumber Number
hi def link koordEvent Label
hi def link koordString String
hi def link koordComment Comment

let b:current_syntax = 'koord'
